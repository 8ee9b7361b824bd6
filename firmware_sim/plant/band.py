"""The band of tremor, 3 to 12 Hz, in what has a value a millisecond."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

LOW_HZ, HIGH_HZ = 3.0, 12.0
_STEP_S = 0.001
Array = NDArray[np.float64]


def filtered(values: Array) -> Array:
    """What of each row is in the band, (rows, milliseconds)."""
    parts = np.fft.rfft(values, axis=1)
    parts[:, ~_is_in(values.shape[1])] = 0.0
    return np.asarray(np.fft.irfft(parts, values.shape[1], axis=1), float)


def speed_power(angle: Sequence[float]) -> float:
    """Power of the speed of an angle within the band; only shares of it mean something."""
    speed = np.diff(angle) / _STEP_S
    power = np.abs(np.fft.rfft(speed * np.hanning(len(speed)))) ** 2
    return float(power[_is_in(len(speed))].sum())


def _is_in(count: int) -> NDArray[np.bool_]:
    hertz = np.fft.rfftfreq(count, _STEP_S)
    return np.asarray((hertz >= LOW_HZ) & (hertz <= HIGH_HZ))
