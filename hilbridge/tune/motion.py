"""How a wearer's hand moved, out of whatever recorded it: hilbridge's own recordings, a CSV, an `xsense.h5`.

Of a recording of hilbridge: the inertial sensor of a hand where it has one, else the elbow as the device measured it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import InputError
from hilbridge.features.packs import file_hash
from hilbridge.intent.acceleration import is_hand
from hilbridge.observe.parts import recordings_in
from hilbridge.observe.reading import read_recording
from hilbridge.rows import DeviceRow, InertialRow, MetaRow
from hilbridge.rows.fields import Witness
from hilbridge.sensors.recorded.hand import hand_acceleration, sound

_HAND_M = 0.35  # from the elbow, as in docs/arm.md
_TOPICS = (InertialRow.topic, DeviceRow.topic, MetaRow.topic)
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Motion:
    """Acceleration of a hand: times (N,) in s, m/s2 (N, 3). hashes: SHA-256 by name of the files; said: what it is of."""

    name: str
    person: str | None
    said: str
    t_s: Array
    acceleration: Array
    hashes: dict[str, str]


def is_recording(path: Path) -> bool:
    """Whether hilbridge itself wrote it."""
    return path.is_dir() or path.suffix.lower() == ".mcap"


def motion_of(path: Path) -> Motion:
    """The motion of one file or run's folder. Raises InputError."""
    if not path.exists():
        raise InputError(f"{path}: no such file; name recordings, a CSV of t_s,x,y,z or an xsense.h5")
    if is_recording(path):
        return _recorded(path)
    t_s, acceleration = hand_acceleration(path)
    return Motion(path.name, None, "hand acceleration", t_s, acceleration, {path.name: file_hash(path)})


def one_person(motions: Sequence[Motion]) -> str | None:
    """The pseudonym that the recordings name, if any. Raises InputError where they name several."""
    people = sorted({one.person for one in motions if one.person is not None})
    if len(people) > 1:
        raise InputError(f"recordings of {len(people)} people ({', '.join(people[:4])}); give those of one wearer")
    return people[0] if people else None


def _recorded(path: Path) -> Motion:
    person: str | None = None
    felt: dict[str, list[tuple[int, float, float, float]]] = {}
    elbow: dict[Witness, list[tuple[int, float]]] = {}
    for row in read_recording(path, _TOPICS):
        if isinstance(row, MetaRow):
            person = person or row.participant
        elif isinstance(row, InertialRow) and row.valid:
            felt.setdefault(row.sensor, []).append((row.captured_ns, row.x, row.y, row.z))
        elif isinstance(row, DeviceRow) and row.velocity_deg_s is not None:
            elbow.setdefault(row.witness, []).append((row.time_ns, row.velocity_deg_s))
    if (sensor := _hand_of(felt)) is not None:
        rows = np.array(sorted(felt[sensor]), float)
        said, t_ns, acceleration = f"inertial sensor {sensor}", rows[:, 0], rows[:, 1:]
    elif elbow:
        said = "the elbow as the device measured it"
        t_ns, acceleration = _swung(elbow.get(Witness.DEVICE) or elbow[Witness.BUS])
    else:
        raise InputError(
            f"{path}: has neither an inertial sensor of a hand nor the device's elbow; record with --inertial"
        )
    once = np.r_[True, np.diff(t_ns) > 0]
    t_s, acceleration = sound(path, (t_ns[once] - t_ns[0]) * 1e-9, acceleration[once])
    hashes = {file.name: file_hash(file) for file in recordings_in([path])}
    return Motion(path.name, person, said, t_s, acceleration, hashes)


def _hand_of(felt: dict[str, list[tuple[int, float, float, float]]]) -> str | None:
    """The sensor to go by: on a hand, and of two that with more samples."""
    return max(filter(is_hand, sorted(felt)), key=lambda name: len(felt[name]), default=None)


def _swung(rows: list[tuple[int, float]]) -> tuple[Array, Array]:
    """The hand's acceleration along its circle about the elbow, from the joint's speed in degrees a second."""
    made = np.array(rows, float)
    made = made[np.r_[True, np.diff(made[:, 0]) > 0]]
    if len(made) < 3:
        return made[:, 0], np.zeros((len(made), 3))
    along = np.gradient(np.radians(made[:, 1]) * _HAND_M, made[:, 0] * 1e-9)
    return made[:, 0], np.stack([along, np.zeros(len(made)), np.zeros(len(made))], axis=1)
