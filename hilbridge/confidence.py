"""From a smoothed probability to a confidence that means what it says: rising maps, one for each condition.

A condition is a number: bits 0 to 2 are the modalities that the window mostly had (`records.Modality`), the bits above
them the level of the wearer's tremor (0: calm). Maps are fitted offline (`hilbridge.learning.training.gate_fit`). Pure.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

ALL_VALID = 0b111
MASKS = range(1, ALL_VALID + 1)
TREMOR_SHIFT = 3
TREMOR_LEVELS = 4  # 0 is calm


def condition_of(mask: int, tremor_level: int = 0) -> int:
    """The condition of a set of modalities and a level of tremor."""
    return mask | tremor_level << TREMOR_SHIFT


@dataclass(frozen=True, slots=True)
class RisingMap:
    """Straight lines between knots (x, y), both rising within 0..1, flat outside of them. Raises ValueError."""

    x: tuple[float, ...]
    y: tuple[float, ...]

    def __post_init__(self) -> None:
        rising = all(a <= b for knots in (self.x, self.y) for a, b in pairwise(knots))
        inside = all(0.0 <= number <= 1.0 for number in (*self.x, *self.y))
        if not (len(self.x) == len(self.y) >= 2 and rising and inside):
            raise ValueError(f"map of {len(self.x)} and {len(self.y)} knots: needs two or more that rise within 0..1")

    def __call__(self, value: float) -> float:
        right = bisect_right(self.x, value)
        if right == 0:
            return self.y[0]
        if right == len(self.x):
            return self.y[-1]
        low, high = self.x[right - 1], self.x[right]
        share = (value - low) / (high - low)
        return self.y[right - 1] + share * (self.y[right] - self.y[right - 1])


@dataclass(frozen=True, slots=True)
class ConfidenceMaps:
    """The maps of one predictor. Raises ValueError for a condition that is none."""

    by_condition: Mapping[int, RisingMap] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for condition in self.by_condition:
            if not (condition & ALL_VALID and 0 < condition < TREMOR_LEVELS << TREMOR_SHIFT):
                raise ValueError(f"map of condition {condition}: no set of modalities and level of tremor")

    def confidence(self, probability: float, condition: int | None) -> float:
        """`probability` as it stands where it has no condition (a script means what it says).

        0 where nothing was fitted for the condition: what was never measured is not acted on.
        """
        if condition is None:
            return probability
        fitted = self.by_condition.get(condition)
        return 0.0 if fitted is None else fitted(probability)

    def highest(self, condition: int) -> float:
        """The confidence that nothing exceeds under a condition; 0 where nothing was fitted for it."""
        fitted = self.by_condition.get(condition)
        return 0.0 if fitted is None else fitted.y[-1]
