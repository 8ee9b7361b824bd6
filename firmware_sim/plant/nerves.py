"""Who moves the worn arm: a plan of where it should be, an inner model of it, delayed feedback, muscles, tremor.

The plan is a path of both joints. Torque is what the inner model says the plan needs, corrected by what was felt a while
ago. Contracted muscle is a spring towards the plan. Ataxia: inertia misjudged, feedback later, muscles weak.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Protocol

from firmware_sim.plant.chain import Pair, wearers_arm
from firmware_sim.plant.muscles import Muscles
from firmware_sim.plant.parameters import value
from firmware_sim.plant.worn import Muscle, WornArm

Plan = Callable[[float], tuple[Pair, Pair, Pair]]  # angles, speeds and accelerations at a time in s
_MODEL = wearers_arm()
_REST = (value("rest_shoulder"), value("rest_elbow"))
_STIFFNESS, _DAMPING = value("joint_stiffness"), value("joint_damping")
_STRENGTH = (value("shoulder_strength"), value("elbow_strength"))


class Tremor(Protocol):
    """What shakes, a millisecond at a time."""

    def step(self, speed_rad_s: float) -> tuple[float, float]:
        """Torque at shoulder and elbow."""
        ...


@dataclass(frozen=True)
class Control:
    """How somebody moves. Gains are N m/rad and N m s/rad at the elbow, three times as much at the shoulder. Assumed."""

    delay_ms: int = 30
    gain: float = 6.0
    damping: float = 0.5
    inertia_share: float = 1.0  # of what the limbs really have, in the inner model
    both: float = 0.05  # contracted on both sides
    strength_share: float = 1.0


CONTROLS = MappingProxyType(
    {
        "steady": Control(),
        "weak": Control(gain=2.0, damping=0.3, both=0.02, strength_share=0.3),
        "ataxic": Control(delay_ms=60, gain=3.0, damping=0.15, inertia_share=1.35, both=0.03, strength_share=0.5),
    }
)
_SHOULDER = 3.0


@dataclass(slots=True)
class Person:
    """One wearer's nerves and muscles. `step` is called once a millisecond, in order."""

    plan: Plan
    control: Control = field(default_factory=Control)
    tremor: Tremor | None = None
    _felt: deque[tuple[Pair, Pair]] = field(default_factory=deque)
    _muscles: tuple[Muscles, Muscles] = field(init=False)

    def __post_init__(self) -> None:
        share = self.control.strength_share
        self._muscles = (Muscles(_STRENGTH[0] * share), Muscles(_STRENGTH[1] * share))

    def step(self, arm: WornArm, t_s: float) -> tuple[Muscle, Muscle]:
        """What the muscles of both joints do in this millisecond."""
        at, speed, acceleration = self.plan(t_s)
        needed = self._needed(at, speed, acceleration)
        error = self._error(arm, at, speed)
        shaking = (0.0, 0.0) if self.tremor is None else self.tremor.step(max(abs(speed[0]), abs(speed[1])))
        control, made = self.control, []
        for joint, muscles in enumerate(self._muscles):
            times = _SHOULDER if joint == 0 else 1.0
            wanted = needed[joint] + times * (control.gain * error[0][joint] + control.damping * error[1][joint])
            muscles.excite(wanted, control.both, 0.001)
            stiffness, damping = muscles.spring()
            made.append(Muscle(muscles.torque_nm() + shaking[joint], stiffness, damping, at[joint], speed[joint]))
        return made[0], made[1]

    def _needed(self, at: Pair, speed: Pair, acceleration: Pair) -> Pair:
        still = _MODEL.torque_for(at, (0.0, 0.0), (0.0, 0.0))
        moving = _MODEL.torque_for(at, speed, acceleration)
        share = self.control.inertia_share
        first, second = (
            still[n] + share * (moving[n] - still[n]) + _STIFFNESS * (at[n] - _REST[n]) + _DAMPING * speed[n]
            for n in (0, 1)
        )
        return first, second

    def _error(self, arm: WornArm, at: Pair, speed: Pair) -> tuple[Pair, Pair]:
        """Of angle and speed, as felt a delay ago; nothing before anything could be felt."""
        here, rate = arm.angle, arm.speed
        now = ((at[0] - here[0], at[1] - here[1]), (speed[0] - rate[0], speed[1] - rate[1]))
        self._felt.append(now)
        if len(self._felt) <= self.control.delay_ms:
            return (0.0, 0.0), (0.0, 0.0)
        return self._felt.popleft()
