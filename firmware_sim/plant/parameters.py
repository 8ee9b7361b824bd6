"""Every number of the worn arm, with unit and source, in one table; the three presets of a drive.

Where no measurement stands behind a number the source says "assumed", and why it is of that size.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

_MODEL = "OpenSim arm26 (after Holzbaur, Murray and Delp 2005)"


class Parameter(NamedTuple):
    """One number of the plant."""

    value: float
    unit: str
    source: str


TABLE = MappingProxyType(
    {
        "gravity": Parameter(9.80665, "m/s2", "standard gravity"),
        "upper_arm_mass": Parameter(1.865, "kg", _MODEL),
        "upper_arm_com": Parameter(0.1805, "m", _MODEL),
        "upper_arm_inertia": Parameter(0.0148, "kg m2", _MODEL),
        "upper_arm_length": Parameter(0.290, "m", _MODEL),
        "forearm_mass": Parameter(1.534, "kg", f"{_MODEL}, hand included"),
        "forearm_com": Parameter(0.1815, "m", f"{_MODEL}, hand included"),
        "forearm_inertia": Parameter(0.0193, "kg m2", f"{_MODEL}, hand included"),
        "hand": Parameter(0.35, "m", "assumed: elbow to the middle of the palm, as in the harm part of the safety proof"),
        "joint_damping": Parameter(0.3, "N m s/rad", "assumed: resting joints are published between 0.1 and 0.6"),
        "joint_stiffness": Parameter(1.5, "N m/rad", "assumed: resting elbow in mid range, published between 1 and 3"),
        "rest_shoulder": Parameter(0.2, "rad", "assumed: where passive tissue pulls to"),
        "rest_elbow": Parameter(0.9, "rad", "assumed: where passive tissue pulls to"),
        "active_stiffness": Parameter(40.0, "N m/rad", "assumed: per unit of both activations; 4 at 5 % co-contraction"),
        "active_damping": Parameter(2.0, "N m s/rad", "assumed: keeps the active spring well damped"),
        "activation": Parameter(0.010, "s", "Thelen 2003"),
        "deactivation": Parameter(0.040, "s", "Thelen 2003"),
        "shoulder_strength": Parameter(60.0, "N m", "assumed: order of published isometric maxima"),
        "elbow_strength": Parameter(50.0, "N m", "assumed: order of published isometric maxima"),
        "stop_stiffness": Parameter(60.0, "N m/rad", "assumed: as in the one-joint plant"),
        "stop_damping": Parameter(2.0, "N m s/rad", "assumed: as in the one-joint plant"),
        "cuff_stiffness": Parameter(300.0, "N m/rad", "middle of 80 to 1000, from soft straps to a fitted shell"),
        "cuff_damping": Parameter(1.5, "N m s/rad", "assumed: tissue under the cuff, a third of critical for the device"),
        "device_upper_mass": Parameter(0.9, "kg", "assumed: link and half of the elbow drive"),
        "device_upper_com": Parameter(0.2, "m", "assumed"),
        "device_upper_inertia": Parameter(0.006, "kg m2", "assumed: a slender link"),
        "device_forearm_mass": Parameter(0.5, "kg", "assumed: cuff and link"),
        "device_forearm_com": Parameter(0.163, "m", "assumed: 0.8 N m held level, which follow mode carries"),
        "device_forearm_inertia": Parameter(0.0017, "kg m2", "assumed: 0.015 kg m2 about the elbow in all"),
        "ambient": Parameter(25.0, "deg C", "assumed"),
        "winding_warm": Parameter(100.0, "deg C", "assumed: from here on torque is taken back"),
        "winding_hot": Parameter(120.0, "deg C", "assumed: here there is none; class F wire bears 155"),
        "copper": Parameter(0.00393, "1/K", "resistance of copper at 20 deg C"),
        "friction_speed": Parameter(0.05, "rad/s", "assumed: Coulomb friction is smooth below it"),
    }
)  # fmt: skip


def value(name: str) -> float:
    """One number of the table."""
    return TABLE[name].value


@dataclass(frozen=True)
class Preset:
    """A kind of drive, at the joint. `spring_nm_rad` is in series with the cuff; 0: none."""

    about: str
    rotor_inertia: float  # kg m2, through the gear
    coulomb_nm: float
    lag_s: float
    dead_s: float  # dead time of the transmission, ahead of the lag
    spring_nm_rad: float
    limit_nm: float
    nm_per_ampere: float  # through the gear
    ohm: float
    joule_per_kelvin: float
    kelvin_per_watt: float
    link_share: float = 1.0  # of the device's links in the table
    cuff_nm_rad: float = TABLE["cuff_stiffness"].value


PRESETS = MappingProxyType(
    {
        "quasi-direct": Preset(
            "brushless motor with a gear of 9", 0.008, 0.12, 0.0015, 0.0, 0.0, 6.0, 0.9, 0.2, 60.0, 2.5
        ),
        "series-elastic": Preset(
            "gear of 100 behind a spring", 0.06, 0.25, 0.005, 0.0, 300.0, 6.0, 2.5, 0.6, 40.0, 4.0
        ),
        "soft": Preset(
            "Bowden cables, 200 ms late", 0.003, 0.5, 0.02, 0.2, 0.0, 6.0, 1.2, 0.4, 50.0, 3.0, 0.3, 80.0
        ),
    }
)  # fmt: skip
PRESET_SOURCE = "assumed: orders of magnitude of such drives; only the +200 ms of the soft exosuit are given"
