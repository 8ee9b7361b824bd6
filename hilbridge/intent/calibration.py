"""From logits to probabilities: one temperature for each set of valid modalities (Guo et al. 2017)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hilbridge.confidence import MASKS


def checked_temperatures(temperatures: Mapping[int, float]) -> dict[int, float]:
    """By bit mask of valid modalities (bit = records.Modality), each of 1 to 7 there. Raises ValueError."""
    if set(temperatures) != set(MASKS):
        raise ValueError(f"temperatures of the masks {sorted(temperatures)}: one is needed for each of 1 to 7")
    for mask, value in temperatures.items():
        if not 0.01 <= value <= 100.0:
            raise ValueError(f"temperature {value} of mask {mask}: must be 0.01 to 100")
    return dict(temperatures)


def softmax(logits: NDArray[np.float64]) -> NDArray[np.float64]:
    """Along the last axis, without overflow."""
    made = logits - logits.max(axis=-1, keepdims=True)
    np.exp(made, out=made)
    made /= made.sum(axis=-1, keepdims=True)
    return np.asarray(made)


def sigmoid(value: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """1 / (1 + exp(-value)) without overflow."""
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * np.asarray(value, dtype=np.float64))))
