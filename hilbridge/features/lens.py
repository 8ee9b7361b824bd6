"""A camera's lens: points of its picture with the bending taken out by OpenCV, or put in. Points are 0..1 of the picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from hilbridge.errors import InputError
from hilbridge.features.plane import Homography
from hilbridge.records import GazeSample

_MOST_OFF = 2e-3  # of the picture, there and back again: more, and the lens folds within its picture
_COUNTS = (4, 5, 8)  # of distortion coefficients, as cv2.calibrateCamera gives them
_GRID = tuple((x / 8, y / 8) for x in range(9) for y in range(9))


@dataclass(frozen=True, slots=True)
class Lens:
    """`matrix`: fx, fy, cx, cy in pixels of a picture of this size. `lens_of` makes one that has been looked at."""

    width_px: int
    height_px: int
    matrix: tuple[float, float, float, float]
    distortion: tuple[float, ...]

    def straight(self, x: float, y: float) -> tuple[float, float]:
        """Where a point would be without the lens's bending."""
        points = np.array([[[x * self.width_px, y * self.height_px]]], float)
        matrix = self._matrix()
        found = cv2.undistortPoints(points, matrix, np.array(self.distortion), P=matrix)[0, 0]
        return float(found[0]) / self.width_px, float(found[1]) / self.height_px

    def bent(self, x: float, y: float) -> tuple[float, float]:
        """Where a point of the straight picture is in the camera's own."""
        fx, fy, cx, cy = self.matrix
        ray = np.array([[(x * self.width_px - cx) / fx, (y * self.height_px - cy) / fy, 1.0]], float)
        found, _ = cv2.projectPoints(ray, np.zeros(3), np.zeros(3), self._matrix(), np.array(self.distortion))
        return float(found[0, 0, 0]) / self.width_px, float(found[0, 0, 1]) / self.height_px

    def _matrix(self) -> np.ndarray:
        fx, fy, cx, cy = self.matrix
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def lens_of(key: str, size: tuple[int, int], matrix: Sequence[float], distortion: Sequence[float]) -> Lens:
    """Raises InputError, naming the key, for numbers that no camera of this picture size has."""
    cure = "take both from cv2.calibrateCamera, with the size of the pictures that it was given"
    width, height = size
    if len(matrix) != 4 or len(distortion) not in _COUNTS or not all(map(math.isfinite, (*matrix, *distortion))):
        raise InputError(
            f"{key}: {len(matrix)} and {len(distortion)} numbers; `matrix` has fx, fy, cx, cy, `distortion` 4, 5 or 8; {cure}"
        )
    fx, fy, cx, cy = matrix
    if not (0.2 < fx / width < 10 and 0.2 < fy / height < 10 and 0 < cx < width and 0 < cy < height):
        raise InputError(f"{key}: matrix {list(matrix)} is of no picture of {width} x {height}; {cure}")
    lens = Lens(width, height, (fx, fy, cx, cy), tuple(distortion))
    worst = max(math.dist(lens.bent(*lens.straight(*point)), point) for point in _GRID)
    if not worst <= _MOST_OFF:  # also where it is no number
        raise InputError(f"{key}: the lens folds within its picture (a point comes back {worst:.2g} off); {cure}")
    return lens


@dataclass(frozen=True, slots=True)
class GazeMap:
    """From the eye tracker's picture into the camera's: its lens out, over to the other picture, the camera's lens in."""

    tracker: Lens | None = None
    plane: Homography | None = None
    camera: Lens | None = None

    def sample(self, sample: GazeSample) -> GazeSample:
        """A sample carried over; one that leaves the picture is invalid. One that is invalid is left as it is."""
        if not sample.valid:
            return sample
        x, y = sample.x, sample.y
        if self.tracker is not None:
            x, y = self.tracker.straight(x, y)
        if self.plane is not None:
            x, y = self.plane.carry(x, y)
        if self.camera is not None and math.isfinite(x) and math.isfinite(y):
            x, y = self.camera.bent(x, y)
        if not (0.0 <= x <= 1.0 and 0.0 <= y <= 1.0):
            return replace(sample, x=0.0, y=0.0, valid=False)
        return replace(sample, x=x, y=y)
