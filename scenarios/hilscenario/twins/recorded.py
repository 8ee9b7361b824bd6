"""A tremor that was recorded: acceleration of the hand in a CSV (`t_s,x,y,z`; m/s2) or `xsense.h5`, as elbow torque."""

from __future__ import annotations

from pathlib import Path

from firmware_sim.plant import recorded
from hilbridge.sensors.recorded.hand import hand_acceleration


def torque_of(path: Path) -> tuple[float, ...]:
    """Torque at the elbow, N m, 1000 a second. Raises InputError for a file that cannot be used."""
    return recorded.torque_of(*hand_acceleration(path))
