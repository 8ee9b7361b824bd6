"""What wearers do with their elbow: the 21 behaviours under which an ACT must do no harm, each firm or weak.

A wearer is a spring and damper towards a wanted path, most of the weight carried, and muscle torque of their own on top.
The event of a behaviour (a reach, letting go) is at 1.5 s, the reaches come back every 4 s; ACTs at other times meet
every phase of it. Angles in the table are degrees, torques N m.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from math import cos, pi, radians, sin
from types import MappingProxyType

from firmware_sim.plant.arm import ARM_WEIGHT_NM, CARRIED_SHARE, Arm

FIRM_NM_RAD = 6.0
WEAK_NM_RAD = 2.0
EVENT_S = 1.5
Path = Callable[[float], tuple[float, float]]
Torque = Callable[[float], float]


def nothing(t_s: float) -> float:
    """No torque of their own."""
    del t_s
    return 0.0


@dataclass(frozen=True)
class Wearer:
    """`path` gives (rad, rad/s) at a time; `torque` comes on top, N m; after `limp_s` the muscles do nothing at all."""

    about: str
    path: Path
    torque: Torque = nothing
    limp_s: float = math.inf
    stiffness: float = FIRM_NM_RAD

    def __call__(self, arm: Arm, t_s: float) -> float:
        """Torque of the wearer's muscles and of what they hold, N m. Damping goes with the root of stiffness."""
        if t_s >= self.limp_s:
            return 0.0
        angle, velocity = self.path(t_s)
        damping = 0.8 * math.sqrt(self.stiffness / FIRM_NM_RAD)
        own = CARRIED_SHARE * ARM_WEIGHT_NM * sin(arm.angle)
        return own + self.stiffness * (angle - arm.angle) + damping * (velocity - arm.velocity) + self.torque(t_s)


def _at(degrees: float) -> Path:
    return lambda t_s: (radians(degrees), 0.0)


def _sway(hertz: float, degrees: float) -> Path:
    rate, size = 2.0 * pi * hertz, radians(degrees)
    return lambda t_s: (radians(65.0) + size * sin(rate * t_s), size * rate * cos(rate * t_s))


def _drift(degrees_s: float, start: float) -> Path:
    """At a steady speed from 1 s on, for 5 s."""
    rate = radians(degrees_s)

    def path(t_s: float) -> tuple[float, float]:
        gone = min(max(t_s - 1.0, 0.0), 5.0)
        return radians(start) + rate * gone, rate if 0.0 < gone < 5.0 else 0.0

    return path


def _reach(seconds: float, degrees: float, stops_at: float = 1.0) -> Path:
    """Out at 1.5 s and back 2 s later, every 4 s, minimum jerk; `stops_at` is the part of the way where it is braked."""
    low, span = radians(40.0), radians(degrees)

    def moved(s: float) -> tuple[float, float]:
        if s <= 0.0:
            return 0.0, 0.0
        if s >= stops_at:
            return stops_at**3 * (10.0 + stops_at * (6.0 * stops_at - 15.0)), 0.0
        return s**3 * (10.0 + s * (6.0 * s - 15.0)), 30.0 * s * s * (1.0 + s * (s - 2.0)) / seconds

    def path(t_s: float) -> tuple[float, float]:
        phase = (t_s - EVENT_S) % 4.0 if t_s >= EVENT_S else -1.0
        out, rate = moved(phase / seconds)
        if phase < 2.0:
            return low + span * out, span * rate
        top, (back, rate) = moved(1.0)[0], moved((phase - 2.0) / seconds)
        return low + span * (top - back), -span * rate

    return path


def tremor(hertz: float, size_nm: float) -> Torque:
    """A shaking torque."""
    return lambda t_s: size_nm * sin(2.0 * pi * hertz * t_s)


def _from_event(size_nm: float, until_s: float = math.inf) -> Torque:
    return lambda t_s: size_nm if EVENT_S <= t_s < until_s else 0.0


def _until_event(size_nm: float) -> Torque:
    return lambda t_s: size_nm if t_s < EVENT_S else 0.0


_TABLE: dict[str, Wearer] = {
    "still": Wearer("holds still at 45", _at(45.0)),
    "still, level": Wearer("holds still at 90", _at(90.0)),
    "holds a load": Wearer("holds still at 60, a load of 1 N m not carried", _at(60.0), lambda t_s: -1.0),
    "slow sway": Wearer("0.15 Hz, 20 to each side", _sway(0.15, 20.0)),
    "sway": Wearer("0.4 Hz, 25 to each side", _sway(0.4, 25.0)),
    "quick sway": Wearer("1 Hz, 15 to each side", _sway(1.0, 15.0)),
    "stirring": Wearer("2 Hz, 8 to each side", _sway(2.0, 8.0)),
    "slow reach": Wearer("55 in 1.8 s", _reach(1.8, 55.0)),
    "reach": Wearer("55 in 1 s", _reach(1.0, 55.0)),
    "fast reach": Wearer("55 in 0.5 s", _reach(0.5, 55.0)),
    "flick": Wearer("35 in 0.25 s", _reach(0.25, 35.0)),
    "braked reach": Wearer("55 in 1 s, stopped dead at half the time", _reach(1.0, 55.0, 0.5)),
    "lowering": Wearer("8 a second downwards", _drift(-8.0, 85.0)),
    "raising": Wearer("8 a second upwards", _drift(8.0, 45.0)),
    "pulls down": Wearer("holds at 70, then 1.5 N m downwards", _at(70.0), _from_event(-1.5)),
    "lets go": Wearer("holds at 70, then limp", _at(70.0), limp_s=EVENT_S),
    "drops a load": Wearer("holds 1.5 N m at 60 and loses it", _at(60.0), _until_event(-1.5)),
    "slow tremor": Wearer("3 Hz, 1 N m, at 50", _at(50.0), tremor(3.0, 1.0)),
    "tremor": Wearer("6 Hz, 1.5 N m, at 50", _at(50.0), tremor(6.0, 1.5)),
    "quick tremor": Wearer("12 Hz, 2 N m, at 50", _at(50.0), tremor(12.0, 2.0)),
    "shaky reach": Wearer("55 in 1 s with 5 Hz, 1 N m", _reach(1.0, 55.0), tremor(5.0, 1.0)),
}
BEHAVIOURS = MappingProxyType(_TABLE)
