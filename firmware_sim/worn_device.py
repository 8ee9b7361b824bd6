"""The controller on the worn arm: today's law at the elbow, the shoulder balanced by springs. Beside `device.py`.

The encoder is the device's, not the arm's; the torque sensor is at the cuff. The controller takes the upper arm to hang:
the drive adds the weight of the device's links that comes with a raised upper arm.
"""

from __future__ import annotations

from math import degrees, sin

from firmware_sim.controllers import step_of
from firmware_sim.memory import ControllerState, Inputs
from firmware_sim.plant.drive import Drive
from firmware_sim.plant.nerves import Person
from firmware_sim.plant.parameters import PRESETS, Preset
from firmware_sim.plant.worn import WornArm
from firmware_sim.profiles import Profiles, shipped
from firmware_sim.secoc import DEMO_KEY
from firmware_sim.torque import DEVICE_WEIGHT_UNM

_TICK_S = 0.001
_MDEG = degrees(1000.0)


class WornDevice:
    """Controller, drive, arm and person, a millisecond at a time."""

    def __init__(
        self,
        person: Person,
        preset: Preset = PRESETS["quasi-direct"],
        cuff_nm_rad: float | None = None,
        profiles: Profiles | None = None,
    ) -> None:
        self.state = ControllerState(DEMO_KEY, 1, profiles=profiles or shipped())
        self.person, self.drive = person, Drive(preset)
        self.arm = WornArm(preset, cuff_nm_rad, angle=person.plan(0.0)[0])
        self.ticks = 0
        self._advance, self._inputs, self._commanded_unm = step_of(self.state), Inputs(), 0

    def tick(self) -> None:
        """One millisecond of the device's own time, no frames received."""
        self.ticks += 1
        state, arm, inputs, drive = self.state, self.arm, self._inputs, self.drive
        muscles = self.person.step(arm, self.ticks * _TICK_S)
        elbow, speed = arm.device_angle[1], arm.device_speed[1]
        inputs.angle_mdeg = inputs.second_angle_mdeg = round(elbow * _MDEG)
        inputs.velocity_mdeg_s = round(speed * _MDEG)
        inputs.user_torque_unm = round(arm.cuff_torque()[1] * 1e6)
        inputs.measured_unm = round(drive.torque_nm * 1e6)
        inputs.commanded_unm = self._commanded_unm
        self._advance(state, inputs, self.ticks)
        law = state.torque
        self._commanded_unm = law.assist_unm + law.gravity_unm + state.follow_unm
        elbow_nm = drive.step(self._commanded_unm * 1e-6, _TICK_S)
        arm.step(self._with_balance(elbow_nm), muscles, _TICK_S)

    def _with_balance(self, elbow_nm: float) -> tuple[float, float]:
        """Springs carry the links' weight: all of it at the shoulder, at the elbow what a raised upper arm adds."""
        links, (shoulder, elbow) = self.arm.links, self.arm.device_angle
        if links is None:
            return 0.0, 0.0
        fore = links.fore_weight * sin(shoulder + elbow)
        carried = DEVICE_WEIGHT_UNM * 1e-6 * sin(elbow)
        return links.upper_weight * sin(shoulder) + fore, elbow_nm + fore - carried
