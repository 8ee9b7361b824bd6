"""The worn arm: the wearer's two joints and the device's, joined by the cuffs. Explicit physics, no protocol.

1 kHz, semi-implicit Euler, in substeps: the cuff on the device's small inertia is the quickest part. Torque in N m.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, hypot, radians, sin, tanh

from firmware_sim.plant.chain import Chain, Pair, device_links, wearers_arm
from firmware_sim.plant.parameters import PRESETS, Preset, value

SUBSTEPS = 4
_DAMPING, _STIFFNESS = value("joint_damping"), value("joint_stiffness")
_REST = (value("rest_shoulder"), value("rest_elbow"))
_CUFF_DAMPING = value("cuff_damping")
_SMOOTH = 1.0 / value("friction_speed")
_LENGTH, _HAND = value("upper_arm_length"), value("hand")
_STOP, _STOP_DAMPING = value("stop_stiffness"), value("stop_damping")
STOPS = ((radians(-40.0), radians(150.0)), (radians(2.0), radians(142.0)))


@dataclass(frozen=True)
class Muscle:
    """What muscles do at one joint over a millisecond: a torque, and a spring and damper towards a moving place."""

    torque_nm: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    at: float = 0.0
    speed: float = 0.0


LIMP = (Muscle(), Muscle())


@dataclass(slots=True)
class WornArm:
    """Angles and speeds of the wearer's joints and of the device's. `preset` None: the arm is free."""

    preset: Preset | None = PRESETS["quasi-direct"]
    cuff_nm_rad: float | None = None  # None: the preset's
    angle: Pair = (0.2, 0.8)
    speed: Pair = (0.0, 0.0)
    device_angle: Pair = (0.2, 0.8)
    device_speed: Pair = (0.0, 0.0)
    substeps: int = SUBSTEPS
    arm: Chain = field(default_factory=wearers_arm)
    links: Chain | None = field(init=False)
    _joined: float = field(init=False)

    def __post_init__(self) -> None:
        self.links = None if self.preset is None else device_links(self.preset)
        self._joined = 0.0 if self.preset is None else joined(self.preset, self.cuff_nm_rad)
        self.device_angle = self.angle

    def cuff_torque(self) -> Pair:
        """What the arm does to the device through the cuffs: what its torque sensors read."""
        stiffness, (one, two), (here, there) = self._joined, self.angle, self.device_angle
        if self.links is None:
            return 0.0, 0.0
        return (
            stiffness * (one - here) + _CUFF_DAMPING * (self.speed[0] - self.device_speed[0]),
            stiffness * (two - there) + _CUFF_DAMPING * (self.speed[1] - self.device_speed[1]),
        )

    def step(self, device_nm: Pair, muscles: tuple[Muscle, Muscle], dt_s: float = 0.001) -> None:
        """Over `dt_s` under the drives' torque and the wearer's muscles."""
        part_s = dt_s / self.substeps
        for _ in range(self.substeps):
            self._substep(device_nm, muscles, part_s)

    def _substep(self, device_nm: Pair, muscles: tuple[Muscle, Muscle], dt_s: float) -> None:
        angle, speed, arm, links = self.angle, self.speed, self.arm, self.links
        cuff = self.cuff_torque()
        first, second = arm.free(angle, speed)
        first += _own(0, angle[0], speed[0], muscles[0]) - cuff[0]
        second += _own(1, angle[1], speed[1], muscles[1]) - cuff[1]
        one, two = arm.acceleration(angle[1], (first, second))
        self.speed = (speed[0] + one * dt_s, speed[1] + two * dt_s)
        self.angle = (angle[0] + self.speed[0] * dt_s, angle[1] + self.speed[1] * dt_s)
        if links is None or self.preset is None:
            return
        there, rate, rubs = self.device_angle, self.device_speed, self.preset.coulomb_nm
        first, second = links.free(there, rate)
        first += device_nm[0] + cuff[0] - rubs * tanh(rate[0] * _SMOOTH)
        second += device_nm[1] + cuff[1] - rubs * tanh(rate[1] * _SMOOTH)
        one, two = links.acceleration(there[1], (first, second))
        self.device_speed = (rate[0] + one * dt_s, rate[1] + two * dt_s)
        self.device_angle = (there[0] + self.device_speed[0] * dt_s, there[1] + self.device_speed[1] * dt_s)

    def hand(self) -> Pair:
        """Where the hand is from the shoulder: forwards and up, m."""
        first, both = self.angle[0], self.angle[0] + self.angle[1]
        return _LENGTH * sin(first) + _HAND * sin(both), -_LENGTH * cos(first) - _HAND * cos(both)

    def energy_j(self) -> float:
        """Kinetic and potential energy of arm, device, cuffs and stops."""
        total = _energy(self.arm, self.angle, self.speed)
        total += 0.5 * _STIFFNESS * sum((at - rest) ** 2 for at, rest in zip(self.angle, _REST, strict=True))
        for at, (low, high) in zip(self.angle, STOPS, strict=True):
            total += 0.5 * _STOP * max(low - at, at - high, 0.0) ** 2
        if self.links is not None:
            total += _energy(self.links, self.device_angle, self.device_speed)
            apart = hypot(self.angle[0] - self.device_angle[0], self.angle[1] - self.device_angle[1])
            total += 0.5 * self._joined * apart * apart
        return total


def joined(preset: Preset, cuff_nm_rad: float | None = None) -> float:
    """Stiffness between drive and arm: the cuff, and the drive's spring in series."""
    cuff = preset.cuff_nm_rad if cuff_nm_rad is None else cuff_nm_rad
    return cuff if preset.spring_nm_rad == 0.0 else 1.0 / (1.0 / cuff + 1.0 / preset.spring_nm_rad)


def _own(joint: int, angle: float, speed: float, muscle: Muscle) -> float:
    torque = muscle.torque_nm + muscle.stiffness * (muscle.at - angle) + muscle.damping * (muscle.speed - speed)
    torque -= _STIFFNESS * (angle - _REST[joint]) + _DAMPING * speed
    return torque + stop_torque(STOPS[joint], angle, speed)


def stop_torque(stops: Pair, angle: float, speed: float) -> float:
    """What the end of a joint's range does."""
    low, high = stops
    if angle < low:
        return _STOP * (low - angle) - _STOP_DAMPING * speed
    return _STOP * (high - angle) - _STOP_DAMPING * speed if angle > high else 0.0


def _energy(chain: Chain, angle: Pair, speed: Pair) -> float:
    first, second = speed
    coupled = chain.coupling * cos(angle[1])
    kinetic = 0.5 * (chain.about_shoulder + 2.0 * coupled + chain.rotor) * first * first
    kinetic += (chain.about_elbow + coupled) * first * second + 0.5 * (chain.about_elbow + chain.rotor) * second**2
    return kinetic - chain.upper_weight * cos(angle[0]) - chain.fore_weight * cos(angle[0] + angle[1])
