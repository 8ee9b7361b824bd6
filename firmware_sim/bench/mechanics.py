"""What the plant bus needs of mechanics, and today's elbow behind it. Another arm takes its place by the same two functions."""

from __future__ import annotations

import math
from functools import partial
from math import sin
from typing import Protocol

from firmware_sim.bench.wire import Reading
from firmware_sim.plant.actuator import Actuator
from firmware_sim.plant.arm import ARM_WEIGHT_NM, CARRIED_SHARE, Arm, wearer_torque

STEP_S = 0.001
_MDEG = math.degrees(1000.0)
_CARRIED_UNM = 1e6 * CARRIED_SHARE * ARM_WEIGHT_NM  # the torque sensor is zeroed on the resting arm


class Mechanics(Protocol):
    """An arm in a device, with its wearer and its motors: one or two joints, the elbow first."""

    def readings(self) -> tuple[Reading, ...]:
        """What its sensors say now."""

    def step(self, commanded_unm: tuple[int, ...]) -> None:
        """One millisecond under these torques, a joint each."""


class Elbow:
    """One joint: actuator, arm and one of plant.arm.WEARERS."""

    def __init__(self, wearer: str) -> None:
        self._arm, self._actuator = Arm(), Actuator()
        self._muscles = partial(wearer_torque, wearer)
        self._steps = 0
        self._wearer_nm = self._muscles(self._arm, 0.0)

    def readings(self) -> tuple[Reading, ...]:
        """The elbow's."""
        angle = round(self._arm.angle * _MDEG)
        user_unm = round(self._wearer_nm * 1e6) - round(_CARRIED_UNM * sin(self._arm.angle))
        measured_unm = round(self._actuator.torque_nm * 1e6)
        return (Reading(angle, angle, round(self._arm.velocity * _MDEG), user_unm, measured_unm),)

    def step(self, commanded_unm: tuple[int, ...]) -> None:
        """As `Device.tick` has it: motor, then arm."""
        self._actuator.step(commanded_unm[0] * 1e-6, STEP_S)
        self._arm.step(self._actuator.torque_nm, self._wearer_nm, STEP_S)
        self._steps += 1
        self._wearer_nm = self._muscles(self._arm, self._steps * STEP_S)
