"""What a bus says of bridge and device, folded into one view. Pure: frames and times in, a view out; it sends nothing."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any

from hilbridge.bus.message_set import worst_frame_bits
from hilbridge.limits import MS, SENSING_LIMIT_MS
from hilbridge.monitor.words import (
    NO_BRIDGE,
    NO_DEVICE,
    NO_LINK,
    NO_SENSING,
    OLD_SENSING,
    SENSORS,
    STARTING,
    Kind,
    Said,
    reason_words,
    state_word,
)
from hilbridge.records import Frame, Modality
from hilbridge.rows import BeliefRow, TickRow
from hilbridge.verbs import VERBS
from hilbridge.wire.codec import Codec, Decoded
from hilbridge.wire.link import WireLink

WINDOW_NS = 30_000 * MS  # of confidence and verbs
DEVICE_SILENT_NS = 120 * MS  # twice what the bridge allows a CTRL_STATUS: a page must not flicker
BRIDGE_SILENT_NS = 250 * MS  # what the device allows a heartbeat
_LOAD_NS = 1_000 * MS
_BLINK_NS = 400 * MS
_MOST_EVENTS = 100
_TRACE_STEP_NS = 90 * MS
_TOP = 5


@dataclass(frozen=True, slots=True)
class Link:
    """The port as its owner sees it."""

    up: bool = True
    reason: str = ""
    controller: str = "unknown"
    tx_errors: int | None = None
    rx_errors: int | None = None
    frames_lost: int = 0


@dataclass(frozen=True, slots=True)
class Thresholds:
    """The gate's, where they are known: from the bundle that the bridge names, or from a recording."""

    tau_on: float | None = None
    tau_off: float | None = None


@dataclass(slots=True)
class Heard:
    """The newest signals of each message, and when they came."""

    signals: dict[str, dict[str, Any]] = field(default_factory=dict)
    at_ns: dict[str, int] = field(default_factory=dict)

    def value(self, message: str, signal: str) -> Any:
        """None where it was never heard."""
        return self.signals.get(message, {}).get(signal)

    def age_ns(self, message: str, now_ns: int) -> int | None:
        """Since the newest accepted frame of a message; None where there was none."""
        at_ns = self.at_ns.get(message)
        return None if at_ns is None else max(0, now_ns - at_ns)


class Watch:
    """The one who looks on. Frames and times must not go back."""

    def __init__(self, codec: Codec, begin_ns: int, bitrate: int = 500_000) -> None:
        self.link = Link()
        self.thresholds = Thresholds()
        self._wire = WireLink(codec, node="")  # nobody's own messages: all are read
        self._begin_ns = begin_ns
        self._bitrate = bitrate
        self._heard = Heard()
        self._trace: deque[tuple[int, float, str | None]] = deque()
        self._frames: deque[tuple[int, int]] = deque()
        self._bits = 0
        self._events: deque[tuple[int, str]] = deque(maxlen=_MOST_EVENTS)
        self._said: dict[str, str] = {}
        self._lost_ns: dict[str, int] = {}  # since when the bridge does without a sensor
        self._reason_text = ""
        self._tick: TickRow | None = None
        self._belief: BeliefRow | None = None
        self.verbs = VERBS  # of the bundle in use

    # In

    def take(self, frame: Frame, now_ns: int) -> None:
        """One frame of the bus. Never raises."""
        self._count(frame, now_ns)
        outcome = self._wire.decode(frame)
        if not isinstance(outcome, Decoded):
            return
        name, signals = outcome.name, dict(outcome.signals)
        if name == "STOP":
            if self._heard.age_ns("STOP", now_ns) is None or now_ns - self._heard.at_ns["STOP"] > 100 * MS:
                self.tell("STOP on the bus", now_ns)
        elif name == "CTRL_EMCY" and signals["Code"] != "None":
            self.tell(f"device: {reason_words(str(signals['Code'])).text} ({signals['State']})", now_ns)
        elif name in ("BRIDGE_DIAG", "CTRL_DIAG"):
            signals = {**self._heard.signals.get(name, {}), **signals}
            signals.pop("Index", None)
        elif name == "ACT_CMD":
            verb = str(signals["Verb"]) if signals["Gate"] == "Act" else None
            self._trace.append((now_ns, float(signals["Confidence"]) / 100, verb))
        self._heard.signals[name] = signals
        self._heard.at_ns[name] = now_ns

    def take_tick(self, row: TickRow) -> None:
        """What a recording knows better than the bus: the bridge's own reason and thresholds."""
        self._tick = row
        if row.tau_on is not None:
            self.thresholds = Thresholds(row.tau_on, row.tau_off)

    def take_belief(self, row: BeliefRow) -> None:
        """Of a recording: what the predictor thought of every verb."""
        self._belief = row

    def set_link(self, link: Link) -> None:
        """How the port is now."""
        self.link = link

    def tell(self, text: str, now_ns: int) -> None:
        """Put a line into the log."""
        self._events.append((now_ns, text))

    def _count(self, frame: Frame, now_ns: int) -> None:
        bits = worst_frame_bits(min(len(frame.data), 8), extended=frame.is_extended)
        self._frames.append((now_ns, bits))
        self._bits += bits

    # Out

    @property
    def bundle_id(self) -> int | None:
        """Of the bundle that the bridge says it uses; None while it has not said."""
        value = self._heard.value("BRIDGE_HB", "BundleId")
        return None if value is None else int(value)

    @property
    def key(self) -> tuple[str, ...]:
        """What a person must see at once when it changes."""
        return (*self._said.values(), self._reason_text)

    def advance(self, now_ns: int) -> None:
        """Let time pass: what is old is forgotten, and what changed is told in the log."""
        while self._trace and self._trace[0][0] < now_ns - WINDOW_NS:
            self._trace.popleft()
        while self._frames and self._frames[0][0] <= now_ns - _LOAD_NS:
            self._bits -= self._frames.popleft()[1]
        self._changed("bus", "" if self.link.up else self.link.reason or "down", now_ns, "bus is back")
        state = self._state(now_ns)
        self._reason_text = state["reason"]
        word = " ".join(filter(None, (state["word"], state["verb"])))
        self._changed("state", word, now_ns, "", f"{word}: {state['reason']}")
        for name, sensor in self._sensors(now_ns).items():
            self._follow_sensor(name, sensor, now_ns)

    def _follow_sensor(self, name: str, there: bool | None, now_ns: int) -> None:
        """Since when the bridge does without it. The log leaves out what is as short as a blink."""
        if there is not False:
            self._lost_ns.pop(name, None)
        lost_ns = None if there is not False else self._lost_ns.setdefault(name, self._heard.at_ns["BRIDGE_HB"])
        named = f"{name} {'are' if name == 'hands' else 'is'}"
        if lost_ns is None:
            self._changed(name, "", now_ns, f"{named} used again")
        elif now_ns - lost_ns >= _BLINK_NS:
            self._changed(name, f"{named} not used", lost_ns, "")

    def _changed(self, what: str, said: str, now_ns: int, back: str, text: str = "") -> None:
        before = self._said.get(what)
        self._said[what] = said
        if before is not None and before != said:  # how things stood at first is no event
            self.tell(text or said or back, now_ns)

    def view(self, now_ns: int) -> dict[str, Any]:
        """All that the page shows, as JSON has it."""
        self.advance(now_ns)
        return {
            "s": round((now_ns - self._begin_ns) / 1e9, 2),
            "state": self._state(now_ns),
            "confidence": self._confidence(now_ns),
            "verbs": self._verbs(),
            "sensors": self._sensor_view(now_ns),
            "bus": self._bus(),
            "device": self._device(now_ns),
            "events": [[round((at_ns - self._begin_ns) / 1e9, 1), text] for at_ns, text in self._newest_first()],
            "bundle_id": self.bundle_id,
        }

    def _newest_first(self) -> list[tuple[int, str]]:
        """A recording's own events are told after those that follow from its frames."""
        return sorted(self._events, key=lambda event: event[0])[::-1]

    def _state(self, now_ns: int) -> dict[str, Any]:
        heard = self._heard
        device_age = heard.age_ns("CTRL_STATUS", now_ns)
        if not self.link.up:
            return _told("NO BUS", Kind.SILENT, _with_text(NO_LINK, self.link.reason))
        if device_age is None or device_age > DEVICE_SILENT_NS:
            return _told("NO DEVICE", Kind.SILENT, NO_DEVICE)
        status = heard.signals["CTRL_STATUS"]
        word, kind = state_word(str(status["State"]))
        verb = str(status["AppliedVerb"]) if kind == Kind.ASSIST else None
        said = self._reason(kind, status, now_ns)
        lost_ns = [at_ns for name, at_ns in self._lost_ns.items() if said == SENSORS[name]]
        return _told(word, kind, said, verb) | {"for_s": round((now_ns - lost_ns[0]) / 1e9, 1) if lost_ns else None}

    def _reason(self, kind: str, status: dict[str, Any], now_ns: int) -> Said:
        """The first cause that explains the state: what latched the device, else what the bridge lacks, else its own word."""
        own = reason_words(str(status["Reason"]))
        if kind in (Kind.FAULT, Kind.ASSIST):
            return own
        bridge_age = self._heard.age_ns("BRIDGE_HB", now_ns)
        if bridge_age is None or bridge_age > BRIDGE_SILENT_NS:
            return NO_BRIDGE
        if self._tick is not None and self._tick.sensor_problem is not None:
            return Said(f"A sensor cannot be believed: {self._tick.sensor_problem}.", NO_SENSING.cure)
        missing = [name for name, there in self._sensors(now_ns).items() if there is False]
        if len(missing) == len(Modality):  # the bridge says no more than that it does without all of them
            return NO_SENSING
        for name in ("scene", "gaze"):  # without hands there is nothing to assist: no fault of theirs
            if name in missing:
                return SENSORS[name]
        if self._heard.value("BRIDGE_HB", "BridgeState") == "Starting":
            return STARTING
        age_ms = self._heard.value("ACT_CMD", "SensingAge")
        if age_ms is not None and age_ms > SENSING_LIMIT_MS:
            return SENSORS["hands"] if "hands" in missing else OLD_SENSING
        if self._tick is not None and self._tick.reason != "none":
            return Said(f"The bridge holds: {self._tick.reason.replace('_', ' ')}.")
        if status["Reason"] in ("Hold", "None", "Neutral"):
            return self._hold(missing)
        return own

    def _hold(self, missing: list[str]) -> Said:
        if missing:
            return SENSORS[missing[0]]
        tau_on = self.thresholds.tau_on
        if self._trace and tau_on is not None and self._trace[-1][1] < tau_on:
            return Said("The bridge holds: its confidence is below the threshold.")  # no figure: it is read aloud
        return reason_words("Hold")

    def _sensors(self, now_ns: int) -> dict[str, bool | None]:
        """Modality -> whether the bridge believes it; None while the bridge says nothing."""
        age = self._heard.age_ns("BRIDGE_HB", now_ns)
        mask = self._heard.value("BRIDGE_HB", "SensorValid")
        known = mask is not None and age is not None and age <= BRIDGE_SILENT_NS
        return {one.name.lower(): bool(int(mask) >> one & 1) if known else None for one in Modality}

    def _sensor_view(self, now_ns: int) -> dict[str, Any]:
        age_ms = self._heard.value("ACT_CMD", "SensingAge")
        command_age = self._heard.age_ns("ACT_CMD", now_ns)
        known = isinstance(age_ms, int | float) and age_ms < 510
        return {
            "valid": self._sensors(now_ns),
            "age_ms": age_ms if known and command_age is not None and command_age < BRIDGE_SILENT_NS else None,
            "limit_ms": SENSING_LIMIT_MS,
        }

    def _confidence(self, now_ns: int) -> dict[str, Any]:
        points: list[list[Any]] = []
        next_ns = 0
        for at_ns, value, verb in self._trace:
            if at_ns >= next_ns:
                next_ns = at_ns + _TRACE_STEP_NS
                points.append([round((at_ns - now_ns) / 1e9, 2), value, verb is not None])
        newest = self._trace[-1] if self._trace else None
        return {
            "now": newest[1] if newest is not None and now_ns - newest[0] <= BRIDGE_SILENT_NS else None,
            "tau_on": self.thresholds.tau_on,
            "tau_off": self.thresholds.tau_off,
            "trace": points,
        }

    def _verbs(self) -> dict[str, Any]:
        if self._belief is not None:
            ranked = sorted(zip(self.verbs, self._belief.probabilities, strict=False), key=lambda one: -one[1])[:_TOP]
            return {"of": "likeliest now", "top": [[verb, round(share, 3)] for verb, share in ranked]}
        counts: dict[str, int] = {}
        for _, _, verb in self._trace:
            if verb is not None:
                counts[verb] = counts.get(verb, 0) + 1
        ordered = sorted(counts.items(), key=lambda one: (-one[1], one[0]))[:_TOP]
        total = max(1, len(self._trace))
        return {"of": "commanded, share of the last 30 s", "top": [[v, round(n / total, 3)] for v, n in ordered]}

    def _bus(self) -> dict[str, Any]:
        bad = {name: count for name, count in self._wire.counters.items() if count and name != "RxAccepted"}
        diag = {
            f"{who} {name}": value
            for who, message in (("bridge", "BRIDGE_DIAG"), ("device", "CTRL_DIAG"))
            for name, value in sorted(self._heard.signals.get(message, {}).items())
            if value and name not in ("RxAccepted", "Acts", "Holds")
        }
        return {
            "up": self.link.up,
            "reason": self.link.reason,
            "load": round(self._bits / self._bitrate, 4),
            "frames_s": len(self._frames),
            "controller": self.link.controller,
            "tx_errors": self.link.tx_errors,
            "rx_errors": self.link.rx_errors,
            "lost": self.link.frames_lost,
            "rejected": bad,
            "counters": diag,
        }

    def _device(self, now_ns: int) -> dict[str, Any]:
        age = self._heard.age_ns("CTRL_MEAS", now_ns)
        if age is None or age > BRIDGE_SILENT_NS:
            return {}
        measured, status = self._heard.signals["CTRL_MEAS"], self._heard.signals.get("CTRL_STATUS", {})
        return {
            "joint": str(measured["Joint"]),
            "angle_deg": measured.get("Angle"),
            "velocity_deg_s": measured.get("Velocity"),
            "assist_nm": _rounded(measured.get("AssistTorque")),
            "gravity_nm": _rounded(measured.get("GravityTorque")),
            "authority": status.get("Authority"),
            "armed": bool(status.get("Armed")),
            "session": status.get("Session"),
        }


def _with_text(said: Said, text: str) -> Said:
    """The same cure for a reason in its owner's words."""
    return said._replace(text=f"{said.text} {text}".strip())


def _told(word: str, kind: str, said: Said, verb: str | None = None) -> dict[str, Any]:
    return {"word": word, "kind": kind, "verb": verb, "reason": said.text, "cure": said.cure, "for_s": None}


def _rounded(value: Any) -> Any:
    return None if value is None else round(value, 3)
