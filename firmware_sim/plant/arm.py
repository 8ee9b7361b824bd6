"""The wearer's elbow in the device: one joint, explicit physics, no protocol and no safety logic.

Angle in rad, 0 hanging down, pi/2 level; torques in N m, positive bends the elbow. The wearer is a weak arm that wants
to be somewhere: own gravity partly carried, a spring and damper towards a wanted path, and tremor on top if asked.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from math import cos, radians, sin

ARM_INERTIA = 0.07  # kg m^2, forearm and hand about the elbow (1.5 kg at 0.2 m)
DEVICE_INERTIA = 0.015
ARM_WEIGHT_NM = 2.0  # forearm held level
CARRIED_SHARE = 0.85  # of that weight, by the wearer's own muscles at rest
DEVICE_WEIGHT_NM = 0.8
FRICTION = 0.25  # N m s/rad, tissue and gear
STOP_STIFFNESS = 60.0  # N m/rad beyond the anatomical stops
STOP_LOW = math.radians(2.0)
STOP_HIGH = math.radians(142.0)
TICK_S = 0.001
MDEG = math.degrees(1000.0)  # in one radian
# The torque sensor is zeroed on the resting arm, whose weight the wearer carries to this share.
CARRIED_UNM = 1e6 * CARRIED_SHARE * ARM_WEIGHT_NM
_STILL = math.radians(45.0)
_SWAY_RATE = 2.0 * math.pi * 0.4
_LOW, _SPAN = math.radians(40.0), math.radians(55.0)  # of a reach
WEARERS = ("still", "reach", "sway", "tremor")


@dataclass(slots=True)
class Arm:
    """State of the joint: angle rad, velocity rad/s."""

    angle: float = math.radians(30.0)
    velocity: float = 0.0

    def step(self, device_nm: float, wearer_nm: float, dt_s: float) -> None:
        """Semi-implicit Euler over `dt_s` under the device's torque and the wearer's own."""
        angle, velocity = self.angle, self.velocity
        weight = (ARM_WEIGHT_NM + DEVICE_WEIGHT_NM) * sin(angle)
        stop = 0.0
        if angle < STOP_LOW:
            stop = STOP_STIFFNESS * (STOP_LOW - angle) - 2.0 * velocity
        elif angle > STOP_HIGH:
            stop = STOP_STIFFNESS * (STOP_HIGH - angle) - 2.0 * velocity
        total = device_nm + wearer_nm + stop - weight - FRICTION * velocity
        velocity += total / (ARM_INERTIA + DEVICE_INERTIA) * dt_s
        self.velocity = velocity
        self.angle = angle + velocity * dt_s


def wanted_path(wearer: str, t_s: float) -> tuple[float, float]:
    """Where the wearer wants the elbow at time t, and how fast: (rad, rad/s). `wearer` is one of WEARERS."""
    if wearer == "still":
        return _STILL, 0.0
    if wearer == "sway":
        angle = _SWAY_RATE * t_s
        return radians(60.0 + 25.0 * sin(angle)), radians(25.0 * _SWAY_RATE * cos(angle))
    # A reach out and back every four seconds, minimum jerk, one second each way.
    phase = t_s % 4.0
    going = phase < 2.0
    s = phase if going else phase - 2.0
    if s >= 1.0:
        return _LOW + _SPAN if going else _LOW, 0.0
    square = s * s
    moved = s * square * (10.0 + s * (6.0 * s - 15.0))
    rate = 30.0 * square * (1.0 + s * (s - 2.0))
    return (_LOW + _SPAN * moved, _SPAN * rate) if going else (_LOW + _SPAN * (1.0 - moved), -_SPAN * rate)


def wearer_torque(wearer: str, arm: Arm, t_s: float) -> float:
    """What the wearer's own muscles do, N m: most of the weight, a weak spring to the wanted path, tremor at 6 Hz."""
    angle, velocity = wanted_path(wearer, t_s)
    own_weight = CARRIED_SHARE * ARM_WEIGHT_NM * sin(arm.angle)
    torque = own_weight + 6.0 * (angle - arm.angle) + 0.8 * (velocity - arm.velocity)
    if wearer == "tremor":
        torque += 0.9 * math.sin(2.0 * math.pi * 6.0 * t_s)
    return torque
