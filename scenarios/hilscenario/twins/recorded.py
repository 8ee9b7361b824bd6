"""A tremor that was recorded: acceleration of the hand in a CSV (`t_s,x,y,z`; m/s2) or `xsense.h5`, as elbow torque.

What shakes is the main direction of 3 to 12 Hz. Its torque is that of the forearm's inertia, swung at the hand's distance.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firmware_sim.plant.chain import wearers_arm
from firmware_sim.plant.parameters import value
from hilbridge.errors import InputError

_LOW_HZ, _HIGH_HZ = 3.0, 12.0
_LEAST_S = 2.0
_SENSOR = "HAND_R"
Array = NDArray[np.float64]


def torque_of(path: Path) -> tuple[float, ...]:
    """Torque at the elbow, N m, 1000 a second. Raises InputError for a file that cannot be used."""
    try:
        t_s, acceleration = _from_h5(path) if path.suffix in (".h5", ".hdf5") else _from_csv(path)
    except (OSError, ValueError, KeyError) as error:
        raise InputError(
            f"{path}: {error}: a recorded tremor is a CSV of t_s,x,y,z or an xsense.h5 with HAND_R"
        ) from None
    keep = np.isfinite(t_s) & np.isfinite(acceleration).all(axis=1)
    t_s, acceleration = t_s[keep], acceleration[keep]
    if len(t_s) < 2 or t_s[-1] - t_s[0] < _LEAST_S or np.any(np.diff(t_s) <= 0.0):
        raise InputError(f"{path}: needs rising stamps over {_LEAST_S:g} s or more; record longer, or sort it")
    even = np.arange(t_s[0], t_s[-1], 0.001)
    evenly = np.stack([np.interp(even, t_s, axis) for axis in acceleration.T])
    shakes = _band(evenly)
    _, directions = np.linalg.eigh(shakes @ shakes.T)
    arm = wearers_arm()
    return tuple((directions[:, -1] @ shakes * (arm.about_elbow / value("hand"))).tolist())


def _band(values: Array) -> Array:
    hertz = np.fft.rfftfreq(values.shape[1], 0.001)
    parts = np.fft.rfft(values - values.mean(axis=1, keepdims=True), axis=1)
    parts[:, (hertz < _LOW_HZ) | (hertz > _HIGH_HZ)] = 0.0
    return np.asarray(np.fft.irfft(parts, values.shape[1], axis=1), float)


def _from_csv(path: Path) -> tuple[Array, Array]:
    lines = path.read_text(encoding="utf-8").splitlines()
    if len(lines) < 3:
        raise ValueError("it is empty")
    table = np.genfromtxt(lines, delimiter=",", names=True, dtype=float)
    return np.atleast_1d(table["t_s"]), np.stack([np.atleast_1d(table[axis]) for axis in "xyz"], axis=1)


def _from_h5(path: Path) -> tuple[Array, Array]:
    try:
        import h5py
    except ImportError:
        raise InputError(f"{path}: reading it needs h5py: pip install 'hilbridge[iassistadl]'") from None
    with h5py.File(path) as file:
        group = file["Sensors"][_SENSOR]
        older = "Timestamp_Sensor" not in group
        stamps = np.asarray(group["Timestamp" if older else "Timestamp_Sensor"], float).ravel()
        return stamps * (1e-6 if older else 1.0), np.asarray(group["Accelerometer"], float).T
