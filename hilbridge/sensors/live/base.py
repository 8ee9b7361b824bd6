"""What live devices have in common: stamps carried to this computer's clock, doubt that masks, changes that are said."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import NamedTuple, Protocol, TypeVar

from hilbridge.limits import MS
from hilbridge.records import BodySample, GazeSample, StampSource
from hilbridge.sensors.clock import BOUND_LIMIT_NS, DeviceClock, Probe
from hilbridge.sensors.source import Source, SourceState

FAR_OFF_NS = 1_000 * MS  # a stamp this far from now is no stamp of now
RETRY_FIRST_S, RETRY_MOST_S = 0.25, 1.0


T = TypeVar("T")
Made = TypeVar("Made", covariant=True)


class Raw(Protocol[Made]):
    """A sample as a device gave it. `remote_ns`: its own stamp, or None where it gives none."""

    @property
    def remote_ns(self) -> int | None: ...

    @property
    def objection(self) -> str | None:
        """Why the device itself says that its samples do not count."""

    def sample(self, captured_ns: int, stamp: StampSource, *, trusted: bool) -> Made:
        """The record of it; one that is not trusted is not valid."""


class RawGaze(NamedTuple):
    """A point of regard, 0..1 of the device's scene picture."""

    x: float
    y: float
    valid: bool
    worn: bool = True
    remote_ns: int | None = None

    @property
    def objection(self) -> str | None:
        return None if self.worn else "the glasses are not worn"

    def sample(self, captured_ns: int, stamp: StampSource, *, trusted: bool) -> GazeSample:
        """Valid inside the picture only; what is no number becomes zero."""
        x, y = (self.x, self.y) if math.isfinite(self.x) and math.isfinite(self.y) else (0.0, 0.0)
        good = trusted and self.valid and math.isfinite(self.x) and math.isfinite(self.y)
        return GazeSample(captured_ns, x, y, good and 0.0 <= x <= 1.0 and 0.0 <= y <= 1.0, stamp)


class RawBody(NamedTuple):
    """Three numbers of one sensor on the body."""

    sensor: str
    x: float
    y: float
    z: float
    remote_ns: int | None = None

    @property
    def objection(self) -> str | None:
        return None

    def sample(self, captured_ns: int, stamp: StampSource, *, trusted: bool) -> BodySample:
        """What is no number becomes zero, and is not valid."""
        good = math.isfinite(self.x) and math.isfinite(self.y) and math.isfinite(self.z)
        x, y, z = (self.x, self.y, self.z) if good else (0.0, 0.0, 0.0)
        return BodySample(captured_ns, self.sensor, x, y, z, trusted and good, stamp)


class LiveDevice(Source[T]):
    """Base of the live sources. `clock` is None where samples are stamped on arrival (less `latency_ns`).

    Samples count only while everything affirms: no objection of the device's own (glasses that are not worn), a clock that
    is known, a stamp near now. A clock that is not known at all or was just set, and an objection, make the source GONE (the
    bridge holds); one that is only unsure masks. The first word of `name` says what comes.
    """

    live = True

    def __init__(
        self,
        name: str,
        clock: DeviceClock | None,
        *,
        stamp: StampSource = StampSource.ARRIVAL,
        latency_ns: int = 0,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        super().__init__(name, clock_ns)
        self.clock = clock
        self._stamp, self._latency_ns = stamp, latency_ns
        self.offset_ns = 0  # added to every stamp: what `hilbridge align` found, where no clock is shared
        self._said = ""

    def take_raw(self, raw: Raw[T]) -> None:
        """Judge, stamp and hand on one sample."""
        now_ns = self._clock_ns()
        captured_ns, why, masked = self._captured(raw.remote_ns, now_ns)
        captured_ns = min(captured_ns + self.offset_ns, now_ns)
        why = why or raw.objection
        stamp = self._stamp if raw.remote_ns is not None and why is None else StampSource.ARRIVAL
        if why is None:
            self.last_captured_ns = max(captured_ns, self.last_captured_ns or captured_ns)
            self.state, self.detail = SourceState.RUNNING, ""
        comes = f"{self.name.partition(' ')[0]} comes"
        self.say(why or (f"clock known to {self._bound_ms(now_ns):.0f} ms only, masked" if masked else comes))
        if why is not None:
            self.lose(why)
        sample = self.adjust(raw.sample(captured_ns, stamp, trusted=why is None and not masked))
        self.cell.put(sample)
        self.on_value(sample)

    def take_probe(self, probe: Probe) -> None:
        """One more answer of the device's clock; one that proves that it was set is said."""
        assert self.clock is not None
        step_ns = self.clock.add(probe)
        if step_ns is not None:
            self.lose(f"the device's clock was set by {step_ns / MS:+.0f} ms")

    def lose(self, why: str) -> None:
        """The source does not deliver, and why."""
        self.state, self.detail = SourceState.GONE, why
        self.say(why)

    def say(self, text: str) -> None:
        """Tell a change of the source's condition once."""
        if text != self._said:
            self._said = text
            self.on_event(f"{self.name}: {text}")

    def _captured(self, remote_ns: int | None, now_ns: int) -> tuple[int, str | None, bool]:
        """When a sample was taken, why it cannot be believed (or None), and whether its clock is too unsure."""
        if remote_ns is None:
            return now_ns - self._latency_ns, None, False
        fit = None if self.clock is None else self.clock.fit
        if fit is None:
            return now_ns, "the device's clock is not known yet", False
        captured_ns = fit.to_local(remote_ns)
        if abs(captured_ns - now_ns) > FAR_OFF_NS:
            return now_ns, "stamps are more than a second from now", False
        masked = fit.bound_ns(now_ns) > BOUND_LIMIT_NS
        if captured_ns - now_ns > BOUND_LIMIT_NS:  # within the bound it may seem to come before it was seen
            return now_ns, "stamps lie in the future", masked
        return min(captured_ns, now_ns), None, masked

    def _bound_ms(self, now_ns: int) -> float:
        fit = None if self.clock is None else self.clock.fit
        return math.inf if fit is None else fit.bound_ns(now_ns) / MS


LiveGaze = LiveDevice[GazeSample]
LiveBody = LiveDevice[BodySample]
