"""Two links in the sagittal plane, shoulder and elbow: the equations of motion, in closed form.

`shoulder` is the upper arm's angle from hanging down, `elbow` the forearm's against the upper arm; rad, positive forwards.
The wearer's arm and the device's links are both such a chain.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin

from firmware_sim.plant.parameters import Preset, value

Pair = tuple[float, float]


@dataclass(frozen=True)
class Chain:
    """What the equations need: inertias summed up once. All kg m2, weights in N m when held level."""

    about_shoulder: float
    about_elbow: float
    coupling: float  # kg m2, times cos(elbow)
    upper_weight: float
    fore_weight: float
    rotor: float = 0.0

    def free(self, angle: Pair, speed: Pair) -> Pair:
        """Torque of gravity and of the links' own turning on each joint."""
        fore = self.fore_weight * sin(angle[0] + angle[1])
        turning = self.coupling * sin(angle[1])
        first, second = speed
        return (
            turning * (2.0 * first + second) * second - self.upper_weight * sin(angle[0]) - fore,
            -turning * first * first - fore,
        )

    def acceleration(self, elbow: float, torque: Pair) -> Pair:
        """What `torque` in all does to each joint, rad/s2."""
        coupled = self.coupling * cos(elbow)
        one = self.about_shoulder + 2.0 * coupled + self.rotor
        both = self.about_elbow + coupled
        two = self.about_elbow + self.rotor
        scale = 1.0 / (one * two - both * both)
        first, second = torque
        return (two * first - both * second) * scale, (one * second - both * first) * scale

    def torque_for(self, angle: Pair, speed: Pair, acceleration: Pair) -> Pair:
        """What moves the chain so: the inverse of `acceleration`, gravity carried."""
        coupled = self.coupling * cos(angle[1])
        both = self.about_elbow + coupled
        first, second = self.free(angle, speed)
        one, two = acceleration
        return (
            (self.about_shoulder + 2.0 * coupled + self.rotor) * one + both * two - first,
            both * one + (self.about_elbow + self.rotor) * two - second,
        )


def _of(name: str, fore: str, share: float, rotor: float) -> Chain:
    upper_mass, upper_com = share * value(f"{name}_mass"), value(f"{name}_com")
    mass, com, length = share * value(f"{fore}_mass"), value(f"{fore}_com"), value("upper_arm_length")
    about_elbow = share * value(f"{fore}_inertia") + mass * com * com
    gravity = value("gravity")
    return Chain(
        share * value(f"{name}_inertia") + upper_mass * upper_com**2 + about_elbow + mass * length * length,
        about_elbow,
        mass * length * com,
        (upper_mass * upper_com + mass * length) * gravity,
        mass * com * gravity,
        rotor,
    )


def wearers_arm() -> Chain:
    """The wearer's own arm."""
    return _of("upper_arm", "forearm", 1.0, 0.0)


def device_links(preset: Preset) -> Chain:
    """The device's links with the rotors of its drives."""
    return _of("device_upper", "device_forearm", preset.link_share, preset.rotor_inertia)
