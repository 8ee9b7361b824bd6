"""Acceleration of a hand that was recorded: a CSV (`t_s,x,y,z`; m/s2), or `xsense.h5` of the iAssistADL group."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import InputError, needs_extra

LEAST_S, MOST_S = 2.0, 86_400.0  # the longest is a day: stamps in another unit would fill the memory
_SENSOR = "HAND_R"
Array = NDArray[np.float64]


def hand_acceleration(path: Path) -> tuple[Array, Array]:
    """Times in s (N,) that rise and acceleration (N, 3). Raises InputError for a file that cannot be used."""
    try:
        t_s, acceleration = _from_h5(path) if path.suffix in (".h5", ".hdf5") else _from_csv(path)
    except InputError:
        raise
    except (OSError, ValueError, KeyError) as error:
        raise InputError(
            f"{path}: {error}: a recorded tremor is a CSV of t_s,x,y,z or an xsense.h5 with HAND_R"
        ) from None
    return sound(path, t_s, acceleration)


def sound(path: Path, t_s: Array, acceleration: Array) -> tuple[Array, Array]:
    """What is finite of it. Raises InputError unless the stamps rise over long enough."""
    keep = np.isfinite(t_s) & np.isfinite(acceleration).all(axis=1)
    t_s, acceleration = t_s[keep], acceleration[keep]
    if len(t_s) < 2 or t_s[-1] - t_s[0] < LEAST_S or np.any(np.diff(t_s) <= 0.0):
        raise InputError(f"{path}: needs rising stamps over {LEAST_S:g} s or more; record longer, or sort it")
    if (long_s := t_s[-1] - t_s[0]) > MOST_S:
        raise InputError(f"{path}: lasts {long_s:g} s, longer than a day; give t_s in seconds")
    return t_s, acceleration


def _from_csv(path: Path) -> tuple[Array, Array]:
    lines = path.read_text(encoding="utf-8").splitlines()
    if len(lines) < 3:
        raise ValueError("it is empty")
    table = np.genfromtxt(lines, delimiter=",", names=True, dtype=float)
    return np.atleast_1d(table["t_s"]), np.stack([np.atleast_1d(table[axis]) for axis in "xyz"], axis=1)


def _from_h5(path: Path) -> tuple[Array, Array]:
    with needs_extra("iassistadl"):
        import h5py
    with h5py.File(path) as file:
        group = file["Sensors"][_SENSOR]
        older = "Timestamp_Sensor" not in group
        stamps = np.asarray(group["Timestamp" if older else "Timestamp_Sensor"], float).ravel()
        return stamps * (1e-6 if older else 1.0), np.asarray(group["Accelerometer"], float).T
