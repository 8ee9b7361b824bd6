"""The worn arm as a MuJoCo model, made of the same table: what the plant is held against.

Two chains from one shoulder, joint by joint joined by a tendon that is a spring and damper; rotors are MuJoCo's armature.
"""

from __future__ import annotations

from math import tanh

import mujoco

from firmware_sim.plant.parameters import Preset, value
from firmware_sim.plant.worn import STOPS, joined, stop_torque

STEP_S = 0.0001

_CHAIN = """
<body name="{name}1" pos="0 0 0">
  <joint name="{name}1" type="hinge" axis="0 -1 0" damping="{damping}" stiffness="{stiffness}" springref="{rest1}"
    armature="{rotor}"/>
  <inertial pos="0 0 -{com1}" mass="{mass1}" diaginertia="{i1} {i1} {i1}"/>
  <body name="{name}2" pos="0 0 -{length}">
    <joint name="{name}2" type="hinge" axis="0 -1 0" damping="{damping}" stiffness="{stiffness}" springref="{rest2}"
      armature="{rotor}"/>
    <inertial pos="0 0 -{com2}" mass="{mass2}" diaginertia="{i2} {i2} {i2}"/>
  </body>
</body>"""


def _chain(name: str, upper: str, fore: str, share: float, rotor: float, passive: bool) -> str:
    return _CHAIN.format(
        name=name,
        damping=value("joint_damping") if passive else 0.0,
        stiffness=value("joint_stiffness") if passive else 0.0,
        rest1=value("rest_shoulder"),
        rest2=value("rest_elbow"),
        rotor=rotor,
        com1=value(f"{upper}_com"),
        mass1=share * value(f"{upper}_mass"),
        i1=share * value(f"{upper}_inertia"),
        length=value("upper_arm_length"),
        com2=value(f"{fore}_com"),
        mass2=share * value(f"{fore}_mass"),
        i2=share * value(f"{fore}_inertia"),
    )


def model_of(preset: Preset | None, cuff_nm_rad: float | None = None) -> mujoco.MjModel:
    """The free arm, or the arm with cuffs and device."""
    bodies, tendons = _chain("arm", "upper_arm", "forearm", 1.0, 0.0, True), ""
    if preset is not None:
        bodies += _chain("dev", "device_upper", "device_forearm", preset.link_share, preset.rotor_inertia, False)
        tendons = "".join(
            f'<fixed name="cuff{n}" stiffness="{joined(preset, cuff_nm_rad)}" damping="{value("cuff_damping")}"'
            f' springlength="0"><joint joint="arm{n}" coef="1"/><joint joint="dev{n}" coef="-1"/></fixed>'
            for n in (1, 2)
        )
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/><option timestep="{STEP_S}" gravity="0 0 -{value("gravity")}" '
        f'integrator="RK4"/><worldbody>{bodies}</worldbody><tendon>{tendons}</tendon></mujoco>'
    )


class Twin:
    """MuJoCo's own state of the same arm."""

    def __init__(self, preset: Preset | None, angle: tuple[float, float], cuff_nm_rad: float | None = None) -> None:
        self.model = model_of(preset, cuff_nm_rad)
        self.data = mujoco.MjData(self.model)
        self.coulomb_nm = 0.0 if preset is None else preset.coulomb_nm
        self.data.qpos[:] = [*angle, *angle][: self.model.nq]

    def step(self, torque: tuple[float, ...]) -> None:
        """One millisecond under a torque on each joint; friction and stops are the plant's own laws."""
        for _ in range(round(0.001 / STEP_S)):
            self.data.qfrc_applied[:] = torque[: self.model.nv]
            for joint, stops in enumerate(STOPS):
                self.data.qfrc_applied[joint] += stop_torque(stops, self.data.qpos[joint], self.data.qvel[joint])
            for joint in range(2, self.model.nv):
                self.data.qfrc_applied[joint] -= self.coulomb_nm * tanh(self.data.qvel[joint] / value("friction_speed"))
            mujoco.mj_step(self.model, self.data)
