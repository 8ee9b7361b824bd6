"""From logits to probabilities and one confidence that means what it says (paper, "Calibration").

Temperature rescales the whole vector, with its own value for each set of valid modalities (a network without hands is
wrong more often than it thinks); Platt maps the top logit and isotonic the top probability to the chance of being
right. None of them ever changes the label. Fitting is offline, in `hilbridge.learning.fit`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

ALL_VALID = 0b111
ISOTONIC_CAP = 0.99


class Method(StrEnum):
    """Which map the confidence comes from."""

    NONE = "none"
    TEMPERATURE = "temperature"
    PLATT = "platt"
    ISOTONIC = "isotonic"


@dataclass(frozen=True, slots=True)
class Calibration:
    """Fitted calibrators.

    temperatures: by bit mask of valid modalities (bit = records.Modality); ALL_VALID is always there and stands in for
    masks never seen in calibration. platt: slope and offset on the top centred logit. isotonic: knots (x, y), both
    rising, on the temperature-scaled top probability. Raises ValueError naming what is wrong.
    """

    method: Method = Method.TEMPERATURE
    temperatures: Mapping[int, float] = field(default_factory=lambda: {ALL_VALID: 1.0})
    platt: tuple[float, float] = (1.0, 0.0)
    isotonic_x: tuple[float, ...] = (0.0, 1.0)
    isotonic_y: tuple[float, ...] = (0.0, 1.0)

    def __post_init__(self) -> None:
        if ALL_VALID not in self.temperatures:
            raise ValueError("temperatures: the entry for all modalities valid (7) is missing")
        for mask, value in self.temperatures.items():
            if not (0 < mask <= ALL_VALID and 0.01 <= value <= 100.0):
                raise ValueError(f"temperature {value} of mask {mask}: must be 0.01 to 100 for a mask of 1 to 7")
        if not all(math.isfinite(number) for number in self.platt):
            raise ValueError(f"platt {self.platt}: must be finite")
        x, y = self.isotonic_x, self.isotonic_y
        rising = all(a <= b for knots in (x, y) for a, b in pairwise(knots))
        inside = all(0.0 <= number <= 1.0 for number in (*x, *y))
        if not (len(x) == len(y) >= 2 and rising and inside):
            raise ValueError("isotonic: needs two or more knots that rise within 0..1")

    def temperature(self, mask: int) -> float:
        """The temperature for a set of valid modalities."""
        return self.temperatures.get(mask, self.temperatures[ALL_VALID])

    def apply(self, logits: NDArray[np.floating], mask: int) -> tuple[NDArray[np.float64], int, float]:
        """(K,) logits -> (probabilities (K,) summing to 1, index of the top class, its calibrated confidence 0..1)."""
        values = np.asarray(logits, dtype=np.float64)
        top = int(values.argmax())
        method = self.method
        probabilities = softmax(values / (1.0 if method is Method.NONE else self.temperature(mask)))
        confidence = float(probabilities[top])
        if method is Method.PLATT:
            slope, offset = self.platt
            confidence = sigmoid(slope * float(values[top] - values.mean()) + offset)
        elif method is Method.ISOTONIC:
            confidence = float(np.interp(confidence, self.isotonic_x, self.isotonic_y))
        return probabilities, top, min(1.0, max(0.0, confidence))


def softmax(logits: NDArray[np.float64]) -> NDArray[np.float64]:
    """Along the last axis, without overflow."""
    shifted = np.exp(logits - logits.max(axis=-1, keepdims=True))
    return np.asarray(shifted / shifted.sum(axis=-1, keepdims=True))


def sigmoid(value: float) -> float:
    """1 / (1 + exp(-value)) without overflow."""
    return 0.5 * (1.0 + math.tanh(0.5 * value))
