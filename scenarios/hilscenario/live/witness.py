"""What the bus tells of a device under test, as the lines that a simulated one would have logged. Pure: frames in, lines out.

Torque and movement come every 20 ms and are interpolated later, so that lines wait for the CTRL_MEAS after them: a status
between two would otherwise bend the straight line and make a rise look steeper.
"""

from __future__ import annotations

from typing import Any

from hilbridge.limits import MS
from hilbridge.records import Frame
from hilbridge.wire.codec import Codec, Decoded
from hilbridge.wire.link import WireLink

_LEAST_NM = 0.001  # assist that CTRL_MEAS rounds to nothing while the status says that there is some
_COMMANDS = 64  # remembered, of 256 counters


class Witness:
    """Fed with every frame of the bus in order, the bridge's too; `counters` are the device's, by their DBC names."""

    def __init__(self, codec: Codec) -> None:
        self._wire = WireLink(codec, node="")
        self._verbs = {name: code for code, name in _verb_names(codec).items()}
        self._status: dict[str, Any] | None = None
        self._meas: tuple[int, float, float] | None = None  # when, assist, gravity
        self._waiting: list[dict[str, Any]] = []
        self._commands: dict[int, tuple[int, bool]] = {}  # counter -> when, hold
        self._accepted: tuple[int, bool] | None = None
        self._stop_ms: int | None = None
        self.counters: dict[str, int] = {}
        self.peak_assist_nm = 0.0

    def take(self, frame: Frame) -> list[dict[str, Any]]:
        """The lines that this frame completes."""
        message = self._wire.decode(frame)
        if not isinstance(message, Decoded):
            return []
        now_ms, signals = frame.received_ns // MS, message.signals
        match message.name:
            case "STOP":
                self._stop_ms = now_ms if self._stop_ms is None else self._stop_ms
            case "ACT_CMD":
                self._commands.pop(message.counter, None)
                self._commands[message.counter] = now_ms, signals["Gate"] == "Hold"
                if len(self._commands) > _COMMANDS:
                    self._commands.pop(next(iter(self._commands)))
            case "CTRL_DIAG":
                index = str(signals["Index"])
                self.counters[index] = int(signals[index])
            case "CTRL_STATUS":
                self._accepted = self._commands.get(int(signals["AcceptedCounter"]), self._accepted)
                self._status = dict(signals)
                self._waiting.append(self._line(frame.received_ns))
            case "CTRL_MEAS" if self._status is not None:
                return self._measured(frame.received_ns, signals)
        return []

    def _measured(self, now_ns: int, signals: Any) -> list[dict[str, Any]]:
        assist, gravity = float(signals["AssistTorque"]), float(signals["GravityTorque"])
        self.peak_assist_nm = max(self.peak_assist_nm, abs(assist))
        before_ns, from_assist, from_gravity = self._meas or (now_ns - 1, assist, gravity)
        self._meas = now_ns, assist, gravity
        lines = [*self._waiting, self._line(now_ns)]
        self._waiting = []
        for line in lines:
            share = min(1.0, max(0.0, (line["ends_ns"] - before_ns) / max(1, now_ns - before_ns)))
            there = from_assist + share * (assist - from_assist)
            line["assist_nm"] = 0.0 if line.pop("zero") else there or _LEAST_NM
            line["gravity_nm"] = from_gravity + share * (gravity - from_gravity)
            line["angle_deg"] = float(signals["Angle"])
            line["velocity_deg_s"] = float(signals["Velocity"])
        return lines

    def _line(self, now_ns: int) -> dict[str, Any]:
        status = self._status
        assert status is not None
        when_ms, hold = self._accepted or (0, True)
        return {
            "ends_ns": now_ns,
            "t_ms": now_ns // MS,
            "state": status["State"],
            "reason": status["Reason"],
            "armed": bool(status["Armed"]),
            "session": int(status["Session"]),
            "verb": self._verbs[str(status["AppliedVerb"])],
            "zero": bool(status["AssistZero"]),
            "follow_nm": 0.0,
            "accepted_ms": when_ms,
            "accepted_counter": int(status["AcceptedCounter"]),
            "accepted_hold": hold,
            "accepted_live": self._accepted is not None,
            "stop_ms": self._stop_ms,
            "trips": self.counters.get("Trips", 0),
        }

    def summary(self) -> dict[str, Any]:
        """What a simulated device says last, as far as CTRL_DIAG tells it."""
        rejected = {name: count for name, count in self.counters.items() if name.startswith("Rej") and count}
        return {
            "peak_assist_nm": self.peak_assist_nm,
            "trips": self.counters.get("Trips", 0),
            "rejected": rejected,
            "lost_frames": self.counters.get("LostFrames", 0),
        }


def _verb_names(codec: Codec) -> dict[int, str]:
    signals = codec.messages["CTRL_STATUS"].signals
    names = next(one.names for one in signals if one.name == "AppliedVerb")
    assert names is not None
    return dict(names)
