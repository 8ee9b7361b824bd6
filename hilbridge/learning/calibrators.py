"""Calibrators of windows (paper, "Calibration"): from logits to one confidence that means what it says, for E1 to E3.

Temperature rescales the whole vector, isotonic maps the top probability to the chance of being right, both fitted anew for
each set of valid modalities (a network without hands is wrong more often than it thinks); Platt maps the top logit. None
of them ever changes the label. The running bridge calibrates what its gate compares instead: `training.gate_fit`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hilbridge.confidence import ALL_VALID
from hilbridge.intent.calibration import sigmoid, softmax

ISOTONIC_CAP = 0.99
Knots = tuple[tuple[float, ...], tuple[float, ...]]
IDENTITY: Knots = ((0.0, 1.0), (0.0, 1.0))


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
    masks never seen in calibration. platt: slope and offset on the top centred logit. isotonic: by the same masks, knots
    (x, y), both rising, on the temperature-scaled top probability. Raises ValueError naming what is wrong.
    """

    method: Method = Method.TEMPERATURE
    temperatures: Mapping[int, float] = field(default_factory=lambda: {ALL_VALID: 1.0})
    platt: tuple[float, float] = (1.0, 0.0)
    isotonic: Mapping[int, Knots] = field(default_factory=lambda: {ALL_VALID: IDENTITY})

    def __post_init__(self) -> None:
        if ALL_VALID not in self.temperatures:
            raise ValueError("temperatures: the entry for all modalities valid (7) is missing")
        for mask, value in self.temperatures.items():
            if not (0 < mask <= ALL_VALID and 0.01 <= value <= 100.0):
                raise ValueError(f"temperature {value} of mask {mask}: must be 0.01 to 100 for a mask of 1 to 7")
        if not all(math.isfinite(number) for number in self.platt):
            raise ValueError(f"platt {self.platt}: must be finite")
        if ALL_VALID not in self.isotonic:
            raise ValueError("isotonic: the entry for all modalities valid (7) is missing")
        for mask, (x, y) in self.isotonic.items():
            rising = all(a <= b for knots in (x, y) for a, b in pairwise(knots))
            inside = all(0.0 <= number <= 1.0 for number in (*x, *y))
            if not (0 < mask <= ALL_VALID and len(x) == len(y) >= 2 and rising and inside):
                raise ValueError(
                    f"isotonic of mask {mask}: needs two or more knots that rise within 0..1, a mask of 1 to 7"
                )

    def temperature(self, mask: int) -> float:
        """The temperature for a set of valid modalities."""
        return self.temperatures.get(mask, self.temperatures[ALL_VALID])

    def probabilities(self, logits: NDArray[np.floating], mask: int) -> NDArray[np.float64]:
        """(..., K) logits -> (..., K) probabilities that sum to 1."""
        temperature = 1.0 if self.method is Method.NONE else self.temperature(mask)
        return softmax(np.asarray(logits, dtype=np.float64) / temperature)

    def confidence(self, logits: NDArray[np.floating], mask: int) -> NDArray[np.float64]:
        """(..., K) logits -> (...) calibrated confidence of the top class, 0..1."""
        values = np.asarray(logits, dtype=np.float64)
        return self._of_top(values, self.probabilities(values, mask), mask)

    def apply(self, logits: NDArray[np.floating], mask: int) -> tuple[NDArray[np.float64], int, float]:
        """(K,) logits -> (probabilities (K,) summing to 1, index of the top class, its calibrated confidence 0..1)."""
        values = np.asarray(logits, dtype=np.float64)
        probabilities = self.probabilities(values, mask)
        return probabilities, int(values.argmax()), float(self._of_top(values, probabilities, mask))

    def _of_top(
        self, logits: NDArray[np.float64], probabilities: NDArray[np.float64], mask: int
    ) -> NDArray[np.float64]:
        if self.method is Method.PLATT:
            slope, offset = self.platt
            made = sigmoid(slope * (logits.max(axis=-1) - logits.mean(axis=-1)) + offset)
        else:
            made = probabilities.max(axis=-1)
        if self.method is Method.ISOTONIC:
            made = np.interp(made, *self.isotonic.get(mask, self.isotonic[ALL_VALID]))
        return np.asarray(made)  # within 0..1, as knots are
