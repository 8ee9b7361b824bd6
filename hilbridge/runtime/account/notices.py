"""What a person at the terminal has to know while the bridge runs: troubles that the recording alone would keep. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from hilbridge.runtime.account.spells import Spell

NS_PER_S = 1_000_000_000
DEAF_NS = 2 * NS_PER_S
FEWEST_PICTURES_HZ = 20.0  # the predictor has learnt at 25; docs/features.md
_RATE_NS = 2 * NS_PER_S


@dataclass(frozen=True, slots=True)
class Facts:
    """What is known at one moment.

    heard: frames received so far. device: its state and reason; None while there is none, or it is silent.
    foreign: frames of others so far under identifiers that are this bridge's own. pictures: taken so far.
    clearing: None where nobody asked for it, else whether the device's challenge has been answered.
    """

    now_ns: int
    bus: str
    physical: bool
    listen_only: bool
    heard: int
    device: tuple[str, str] | None
    refused: bool
    foreign: int
    pictures: int
    camera_alive: bool
    clearing: bool | None


class Notices:
    """Looks at the facts once a second or so, and says each trouble when it begins and when it is over."""

    def __init__(self) -> None:
        self._spells: dict[str, Spell] = {}
        self._foreign = 0
        self._heard = (0, 0)  # how many, and when that last grew
        self._first_ns: int | None = None
        self._pictures: tuple[int, int] | None = None
        self._slow = False

    def look(self, facts: Facts) -> list[str]:
        """New lines, in the order of how much they matter."""
        if self._first_ns is None:
            self._first_ns = facts.now_ns
            self._heard = (facts.heard, facts.now_ns)
        troubles = {
            "stop": _stopped(facts),
            "second bridge": self._second_bridge(facts),
            "key": _KEY if facts.refused else None,
            "bus": self._deaf(facts),
            "camera": self._slow_camera(facts),
        }
        said = [self._spells.setdefault(name, Spell()).look(text, facts.now_ns) for name, text in troubles.items()]
        return [text for text in said if text is not None]

    def _second_bridge(self, facts: Facts) -> str | None:
        came, self._foreign = facts.foreign > self._foreign, facts.foreign
        return _SECOND if came else None

    def _deaf(self, facts: Facts) -> str | None:
        if facts.heard > self._heard[0]:
            self._heard = (facts.heard, facts.now_ns)
        if facts.now_ns - self._heard[1] >= DEAF_NS:
            cure = f"`hilbridge doctor --bus {facts.bus}`" if facts.physical else f"`firmware-sim --bus {facts.bus}`"
            return f"bus {facts.bus}: alone, nobody sends or acknowledges; start the device: {cure}"
        assert self._first_ns is not None
        if facts.device is None and facts.now_ns - self._first_ns >= DEAF_NS:
            return f"bus {facts.bus}: frames come, but none of a device (CTRL_STATUS); is it the right bus?"
        return None

    def _slow_camera(self, facts: Facts) -> str | None:
        if self._pictures is None or not facts.camera_alive:
            self._pictures = (facts.pictures, facts.now_ns)
            self._slow = False
        elif facts.now_ns - self._pictures[1] >= _RATE_NS:
            came = facts.pictures - self._pictures[0]
            self._slow = came * NS_PER_S < FEWEST_PICTURES_HZ * (facts.now_ns - self._pictures[1])
            self._pictures = (facts.pictures, facts.now_ns)
        return _SLOW if self._slow else None


_KEY = "key: the device rejects ours, nothing will be assisted; give both the same --key-file and start the device anew"
_SECOND = (
    "second bridge: another node sends what only this one may, the device may latch; end one (`hilbridge doctor --bus`)"
)
_SLOW = (
    f"camera: fewer than {FEWEST_PICTURES_HZ:g} pictures a second, decisions rest on old ones; "
    "ask for 25 (--camera-fps 25), give it more light, or a smaller picture"
)


def _stopped(facts: Facts) -> str | None:
    """The three steps out of a latch or a stop, the next one last (docs/real-bus.md)."""
    if facts.device is None or facts.device[0] not in ("Latched", "EStop"):
        return None
    what = f"device {facts.device[0]} ({facts.device[1]})"
    if facts.clearing is None:
        return f"{what}: find out why, then run again with --clear-latch, then confirm at the device"
    if not facts.clearing:
        return f"{what}: asking it to accept clearing"
    return f"{what}: clearing is authenticated, confirm at the device now (firmware-sim: `clear`, or SIGUSR1)"
