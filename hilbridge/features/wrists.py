"""A skeleton's wrists in the camera's picture: they stand in for hands where the camera sees none. Pure but for a lock."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass

from hilbridge.errors import InputError
from hilbridge.limits import SENSING_LIMIT_NS
from hilbridge.records import BodySample, Hand, HandTracks

_FLATTEST = 1e-9  # determinant of the left part, columns and rows scaled to 1


@dataclass(frozen=True, slots=True)
class Projection:
    """Twelve numbers, row by row: from metres of the skeleton to 0..1 of the picture. `projection_of` checks them."""

    rows: tuple[float, ...]

    def carry(self, x: float, y: float, z: float) -> tuple[float, float]:
        """A place in the picture; (nan, nan) for one behind the camera."""
        a, b, c, d, e, f, g, h, i, j, k, m = self.rows
        depth = i * x + j * y + k * z + m
        if not depth > 0.0:
            return math.nan, math.nan
        return (a * x + b * y + c * z + d) / depth, (e * x + f * y + g * z + h) / depth


def projection_of(numbers: Sequence[float]) -> Projection:
    """Raises InputError for numbers that no camera has."""
    cure = "take it from cv2.solvePnP: the camera matrix in 0..1 of the picture times [R|t]"
    if len(numbers) != 12 or not all(math.isfinite(number) for number in numbers):
        raise InputError(f"skeleton_projection: {len(numbers)} numbers, twelve finite ones are due, row by row; {cure}")
    rows = [tuple(numbers[4 * row : 4 * row + 3]) for row in range(3)]
    lengths = [math.hypot(*row) for row in rows]
    if min(lengths) == 0.0 or abs(_determinant(rows)) < _FLATTEST * math.prod(lengths):
        raise InputError(f"skeleton_projection: it flattens space to a line; {cure}")
    return Projection(tuple(float(number) for number in numbers))


def _determinant(rows: list[tuple[float, ...]]) -> float:
    (a, b, c), (d, e, f), (g, h, i) = rows
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


class WristHands:
    """The newest place of each wrist. `put` and `hands_at` may be called from different threads."""

    def __init__(self, projection: Projection) -> None:
        self._projection = projection
        self._newest: dict[str, BodySample] = {}
        self._lock = threading.Lock()

    def put(self, sample: BodySample) -> None:
        """One more sample; joints that are no wrist are not looked at."""
        if "wrist" not in sample.sensor.lower():
            return
        with self._lock:
            if sample.valid:
                self._newest[sample.sensor] = sample
            else:
                self._newest.pop(sample.sensor, None)

    def hands_at(self, now_ns: int) -> HandTracks | None:
        """The wrists that are in the picture, as hands; None where none is, or what is known is too old."""
        with self._lock:
            samples = [one for one in self._newest.values() if now_ns - one.captured_ns <= SENSING_LIMIT_NS]
        hands, stamps = [], []
        for sample in sorted(samples, key=lambda one: one.sensor):
            x, y = self._projection.carry(sample.x, sample.y, sample.z)
            if 0.0 <= x <= 1.0 and 0.0 <= y <= 1.0:
                hands.append(Hand(x, y, 1.0))
                stamps.append(min(sample.captured_ns, now_ns))
        return HandTracks(min(stamps), tuple(hands)) if hands else None


def stood_in(found: HandTracks | None, wrists: WristHands | None, now_ns: int) -> HandTracks | None:
    """The hands that were found in the picture; where there are none, the wrists of the skeleton."""
    if wrists is None or (found is not None and found.hands):
        return found
    return wrists.hands_at(now_ns) or found
