"""Involuntary movement of the simulated wearer, as a pure function of time: tremor of hands, arm, head and gaze, ataxia.

A plain tremor is a clean sine, as scenarios inject it. A real one wanders in frequency and amplitude, shakes head and gaze with
it, makes the hand detector lose what it sees blurred, and may come with reaches that overshoot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from hilbridge.limits import MS
from hilbridge.wearer.noise import Noise

Point = tuple[float, float]
NOTHING: Point = (0.0, 0.0)
_LOST_NS = 160 * MS  # a hand that is lost stays lost for so long


@dataclass(frozen=True, slots=True)
class Tremor:
    """An involuntary oscillation of hands and arm.

    hz, amplitude (picture widths), arm_deg: of the plain sine. wander: 0..1, how far frequency (by 15 % at 1) and amplitude (by
    all of it) come and go. head, gaze: their own amplitudes, picture widths. lost: share of time in which a hand is not found.
    overshoot: share of a reach by which it passes its goal before it settles (ataxia).
    """

    hz: float
    amplitude: float = 0.02
    arm_deg: float = 3.0
    wander: float = 0.0
    head: float = 0.0
    gaze: float = 0.0
    lost: float = 0.0
    overshoot: float = 0.0


def realistic(hz: float, amplitude: float = 0.02) -> Tremor:
    """A wandering tremor that shakes head and gaze with it, hides hands and overshoots."""
    return Tremor(
        hz,
        amplitude,
        150.0 * amplitude,
        wander=0.8,
        head=0.15 * amplitude,
        gaze=0.6 * amplitude,
        lost=0.15,
        overshoot=0.15,
    )


def tremor_of(seed: int) -> Tremor:
    """The tremor that the person `seed` would have: 3 to 8 Hz, light to strong."""
    rng = np.random.default_rng([seed, 7])
    return realistic(float(rng.uniform(3.0, 8.0)), float(rng.uniform(0.008, 0.035)))


class Shaking:
    """One person's tremor, or none."""

    def __init__(self, tremor: Tremor | None, seed: int) -> None:
        self._tremor = tremor
        self._noise = Noise(seed, 8)
        self._phases: list[float] = np.random.default_rng([seed, 9]).uniform(0.0, 2.0 * math.pi, size=4).tolist()

    def hands(self, t_ns: int) -> tuple[Point, Point]:
        """What is added to both palms."""
        if self._tremor is None:
            return NOTHING, NOTHING
        angle, size = self._angle(t_ns), self._size(t_ns)
        swing, cross = size * math.sin(angle), 0.5 * size * math.sin(angle + 1.0)
        return (swing, cross), (swing, -cross)

    def arm_deg(self, t_ns: int) -> float:
        """What is added to the elbow."""
        if self._tremor is None:
            return 0.0
        return self._tremor.arm_deg * self._strength(t_ns) * math.sin(self._angle(t_ns))

    def head(self, t_ns: int) -> Point:
        """What is added to the head's sway."""
        return self._swing(t_ns, 0.0 if self._tremor is None else self._tremor.head, 0.7)

    def gaze(self, t_ns: int) -> Point:
        """What is added to the point of regard."""
        return self._swing(t_ns, 0.0 if self._tremor is None else self._tremor.gaze, 1.9)

    def loses(self, side: int, t_ns: int) -> bool:
        """Whether the detector has lost this hand."""
        if self._tremor is None or self._tremor.lost <= 0.0:
            return False
        first, second = self._noise.normals(t_ns // _LOST_NS * _LOST_NS, 1)
        chance = 0.5 * (1.0 + math.erf((first, second)[side] / math.sqrt(2.0)))
        return chance < self._tremor.lost * min(2.0, self._strength(t_ns))

    def overshoot(self, since_ns: int) -> float:
        """What is added to the share of a reach that is done, so long after it began."""
        if self._tremor is None or self._tremor.overshoot <= 0.0:
            return 0.0
        after_s = since_ns * 1e-9 - 0.45
        if not 0.0 < after_s < 3.0:
            return 0.0
        return self._tremor.overshoot * math.exp(-after_s / 0.4) * math.sin(2.0 * math.pi * 1.4 * after_s)

    def _swing(self, t_ns: int, size: float, ahead: float) -> Point:
        if size <= 0.0:
            return NOTHING
        angle, strength = self._angle(t_ns) + ahead, self._strength(t_ns)
        return size * strength * math.sin(angle), 0.7 * size * strength * math.sin(angle + 1.3)

    def _angle(self, t_ns: int) -> float:
        assert self._tremor is not None
        t_s = t_ns * 1e-9
        if self._tremor.wander > 0.0:
            # The integral of a frequency that comes and goes by 15 % of wander.
            t_s += (
                0.15
                * self._tremor.wander
                * math.sin(2.0 * math.pi * 0.21 * t_s + self._phases[0])
                / (2.0 * math.pi * 0.21)
            )
        return 2.0 * math.pi * self._tremor.hz * t_s

    def _size(self, t_ns: int) -> float:
        return 0.0 if self._tremor is None else self._tremor.amplitude * self._strength(t_ns)

    def _strength(self, t_ns: int) -> float:
        assert self._tremor is not None
        wander = self._tremor.wander
        if wander <= 0.0:
            return 1.0
        t_s = t_ns * 1e-9
        slow, slower = (
            math.sin(2.0 * math.pi * hz * t_s + phase)
            for hz, phase in zip((0.31, 0.11), self._phases[1:3], strict=True)
        )
        return max(0.0, 1.0 + wander * (0.4 * slow + 0.6 * slower))
