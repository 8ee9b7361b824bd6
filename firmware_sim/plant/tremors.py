"""Involuntary torque of shoulder and elbow, a millisecond at a time, the same for the same seed.

Bands are those of the clinic: essential 4 to 12 Hz, Parkinsonian 4 to 6, cerebellar 3 to 4. Frequency and strength
wander as Ornstein-Uhlenbeck processes. Essential tremor is there always, Parkinsonian fades as its arm moves, cerebellar
grows with movement. Sizes are assumed: 0.5 to 1.5 N m at the elbow.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from math import exp, pi, sin, sqrt
from types import MappingProxyType

_FREQUENCY_S, _STRENGTH_S, _ACTIVITY_S = 2.0, 1.5, 0.7  # how quickly they wander, and how long movement is felt
_MOVES_RAD_S = 0.1
_SHOULDER_SHARE = 0.5  # of the elbow's torque, at the shoulder
_TURN_S = 0.001


@dataclass(frozen=True)
class Kind:
    """`resting` and `moving` are shares of strength; `spread` how far strength wanders, `drift_hz` frequency (1 sigma)."""

    low_hz: float
    high_hz: float
    size_nm: float
    resting: float = 1.0
    moving: float = 1.0
    spread: float = 0.4
    drift_hz: float = 0.3


KINDS = MappingProxyType(
    {
        "essential": Kind(4.0, 12.0, 1.0),
        "parkinsonian": Kind(4.0, 6.0, 1.0, resting=1.0, moving=0.2),
        "cerebellar": Kind(3.0, 4.0, 1.2, resting=0.2, moving=1.0, spread=0.6),
    }
)


class Shaking:
    """One person's tremor of a kind: their own frequency and size, drawn from the seed."""

    def __init__(self, kind: Kind, seed: int) -> None:
        self._kind, self._chance = kind, random.Random(f"tremor {seed}")
        self.hertz = self._chance.uniform(kind.low_hz, kind.high_hz)
        self.size_nm = kind.size_nm * self._chance.uniform(0.5, 1.5)
        self._drift_hz = self._strength = self._active = 0.0
        self._turn = self._chance.random()

    def step(self, speed_rad_s: float) -> tuple[float, float]:
        """Torque of this millisecond at shoulder and elbow; `speed_rad_s` is of the wanted movement."""
        kind, gauss = self._kind, self._chance.gauss
        self._drift_hz = _wandered(self._drift_hz, kind.drift_hz, _FREQUENCY_S, gauss(0.0, 1.0))
        self._strength = _wandered(self._strength, kind.spread, _STRENGTH_S, gauss(0.0, 1.0))
        moves = 1.0 if speed_rad_s > _MOVES_RAD_S else 0.0
        self._active += (moves - self._active) * (_TURN_S / _ACTIVITY_S)
        hertz = min(kind.high_hz, max(kind.low_hz, self.hertz + self._drift_hz))
        self._turn = (self._turn + hertz * _TURN_S) % 1.0
        share = kind.resting + (kind.moving - kind.resting) * self._active
        torque = self.size_nm * share * max(0.0, 1.0 + self._strength) * sin(2.0 * pi * self._turn)
        return _SHOULDER_SHARE * torque, torque


class Recorded:
    """A tremor that somebody had: torque at the elbow, 1000 a second, from the start again when it ends."""

    def __init__(self, torque_nm: tuple[float, ...]) -> None:
        self._torque_nm, self._next = torque_nm, 0

    def step(self, speed_rad_s: float) -> tuple[float, float]:
        """Torque of this millisecond at shoulder and elbow."""
        del speed_rad_s  # what was recorded was recorded while moving
        torque = self._torque_nm[self._next]
        self._next = (self._next + 1) % len(self._torque_nm)
        return _SHOULDER_SHARE * torque, torque


def _wandered(now: float, spread: float, within_s: float, normal: float) -> float:
    keeps = exp(-_TURN_S / within_s)
    return keeps * now + spread * sqrt(1.0 - keeps * keeps) * normal
