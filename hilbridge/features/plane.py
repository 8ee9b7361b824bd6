"""Gaze of one camera's picture carried into another's: a homography between the two, both 0..1 from the top left. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from hilbridge.errors import InputError

_LEAST_AREA = 1e-4  # of the picture: what the whole scene picture must fill at least


@dataclass(frozen=True, slots=True)
class Homography:
    """Nine numbers, row by row. `homography_of` makes one that has been looked at."""

    rows: tuple[float, ...]

    def carry(self, x: float, y: float) -> tuple[float, float]:
        """A point of the eye tracker's picture in the other; (nan, nan) where it lies behind that."""
        a, b, c, d, e, f, g, h, i = self.rows
        depth = g * x + h * y + i
        if depth <= 0.0:
            return math.nan, math.nan
        return (a * x + b * y + c) / depth, (d * x + e * y + f) / depth


def homography_of(numbers: Sequence[float]) -> Homography:
    """Raises InputError for numbers that fold, flip or flatten the picture: then they are of something else."""
    cure = "take it with cv2.findHomography from points in 0..1 of both pictures"
    if len(numbers) != 9 or not all(math.isfinite(number) for number in numbers):
        raise InputError(f"gaze_homography: {len(numbers)} numbers, nine finite ones are due, row by row; {cure}")
    scale = numbers[8] if numbers[8] else 1.0
    plane = Homography(tuple(number / scale for number in numbers))
    corners = [plane.carry(x, y) for x, y in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))]
    if any(math.isnan(x) for x, _ in corners):
        raise InputError(f"gaze_homography: part of the scene picture lies behind the other camera; {cure}")
    turns = [_turn(corners[index - 2], corners[index - 1], corners[index]) for index in range(4)]
    area = (
        sum(one[0] * two[1] - two[0] * one[1] for one, two in zip(corners, corners[1:] + corners[:1], strict=True)) / 2
    )
    if min(turns) <= 0.0 or area < _LEAST_AREA:
        raise InputError(f"gaze_homography: it folds, flips or flattens the picture; {cure}")
    return plane


def _turn(one: tuple[float, float], two: tuple[float, float], three: tuple[float, float]) -> float:
    """Above 0 where three corners turn to the right, as those of a picture do with y counted downwards."""
    return (two[0] - one[0]) * (three[1] - two[1]) - (two[1] - one[1]) * (three[0] - two[0])
