"""The clock of a device against this computer's, from probes that were answered: offset, drift, and how far to trust them.

A probe asks the device for its time. The true offset lies within half the round trip of what the probe says, whatever the
network did to the two ways. Jitter only ever adds, so the quickest tenth of the probes says most. Pure: time is an
argument, local times are of the monotonic clock, a device's of its own.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from hilbridge.limits import MS

BOUND_LIMIT_NS = 10 * MS  # a modality whose clock is less sure than this is masked
FEWEST_PROBES = 5
_KEPT_PROBES = 240
_WINDOW_NS = 60_000 * MS
_DRIFT_SPAN_NS = 5_000 * MS  # a slope over less time than this is noise
_DRIFT_LIMIT = 200e-6  # no quartz is worse
_DRIFT_UNKNOWN = 100e-6  # how far a clock may run off between probes
_STEP_SLACK_NS = 2 * MS


@dataclass(frozen=True, slots=True)
class Probe:
    """One answered question: when it was sent and its answer came (here), and what the device's clock said between."""

    sent_ns: int
    remote_ns: int
    received_ns: int

    @property
    def rtt_ns(self) -> int:
        return self.received_ns - self.sent_ns

    @property
    def middle_ns(self) -> int:
        return (self.sent_ns + self.received_ns) // 2

    @property
    def offset_ns(self) -> int:
        """Local minus remote, if both ways took equally long."""
        return self.middle_ns - self.remote_ns


@dataclass(frozen=True, slots=True)
class ClockFit:
    """Local minus remote at `at_ns` (local), its slope there, what the probes it rests on leave over, and their number.

    `half_rtt_ns` is the most by which two unequal ways can have shifted the quickest probe; `newest_ns` is when the
    clock was last heard.
    """

    at_ns: int
    offset_ns: int
    drift_ppm: float
    residual_ns: int
    half_rtt_ns: int
    newest_ns: int
    probes: int

    def offset_at(self, local_ns: int) -> int:
        """Local minus remote at a local moment."""
        return self.offset_ns + round((local_ns - self.at_ns) * self.drift_ppm * 1e-6)

    def to_local(self, remote_ns: int) -> int:
        """A device's stamp on this computer's clock."""
        return remote_ns + self.offset_at(remote_ns + self.offset_ns)

    def bound_ns(self, now_ns: int) -> int:
        """How far a stamp that was carried over may be off. It grows while the device does not answer."""
        silent_ns = max(0, now_ns - self.newest_ns)
        return self.half_rtt_ns + self.residual_ns + round(silent_ns * _DRIFT_UNKNOWN)


def fit_clock(probes: list[Probe]) -> ClockFit | None:
    """The clock that the quickest tenth of the probes says, at least five of them; None where there are fewer."""
    if len(probes) < FEWEST_PROBES:
        return None
    best = sorted(probes, key=lambda probe: probe.rtt_ns)[: max(FEWEST_PROBES, math.ceil(len(probes) / 10))]
    at_ns = sum(probe.middle_ns for probe in best) // len(best)
    base_ns = best[0].offset_ns
    points = [((probe.middle_ns - at_ns), float(probe.offset_ns - base_ns)) for probe in best]
    mean_ns = sum(offset for _, offset in points) / len(points)
    slope = _slope(points, mean_ns)
    left = [offset - mean_ns - slope * time_ns for time_ns, offset in points]
    residual_ns = math.sqrt(sum(one * one for one in left) / len(left))
    newest_ns = max(probe.received_ns for probe in probes)
    return ClockFit(
        at_ns,
        base_ns + round(mean_ns),
        round(slope * 1e6, 3),
        round(residual_ns),
        best[0].rtt_ns // 2,
        newest_ns,
        len(probes),
    )


def _slope(points: list[tuple[int, float]], mean_ns: float) -> float:
    times = [time_ns for time_ns, _ in points]
    if max(times) - min(times) < _DRIFT_SPAN_NS:
        return 0.0
    spread = sum(float(time_ns) * time_ns for time_ns in times)
    slope = sum(time_ns * (offset - mean_ns) for time_ns, offset in points) / spread
    return min(_DRIFT_LIMIT, max(-_DRIFT_LIMIT, slope))


class DeviceClock:
    """One device's clock, kept from probe to probe. A clock that was set anew is noticed and learnt again."""

    def __init__(self) -> None:
        self.fit: ClockFit | None = None
        self.steps = 0
        self._probes: deque[Probe] = deque(maxlen=_KEPT_PROBES)

    def add(self, probe: Probe) -> int | None:
        """Take one more probe. Returns by how much the clock was set, where this probe proves that it was."""
        step_ns: int | None = None
        if self.fit is not None:
            apart_ns = probe.offset_ns - self.fit.offset_at(probe.middle_ns)
            if abs(apart_ns) > self.fit.bound_ns(probe.middle_ns) + probe.rtt_ns // 2 + _STEP_SLACK_NS:
                step_ns = -apart_ns  # of the device's own clock
                self.steps += 1
                self._probes.clear()
        self._probes.append(probe)
        while probe.received_ns - self._probes[0].received_ns > _WINDOW_NS:
            self._probes.popleft()
        self.fit = fit_clock(list(self._probes))
        return step_ns

    def forget(self) -> None:
        """The device is another, or was started anew."""
        self._probes.clear()
        self.fit = None

    def sure(self, now_ns: int) -> bool:
        """Whether stamps may be carried over now."""
        return self.fit is not None and self.fit.bound_ns(now_ns) <= BOUND_LIMIT_NS
