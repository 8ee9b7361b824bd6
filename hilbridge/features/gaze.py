"""Gaze: blinks bridged, noise smoothed, saccades followed at once (paper, "Inputs and Encoder").

A constant-position Kalman filter with the noise measured for head-worn trackers at 200 Hz (q = 4 px^2 per
5 ms, r = 60 px^2 in a 1280-wide picture) that starts anew when the innovation's chi-square exceeds 16. A
constant-velocity filter overshoots every saccade and takes 140 ms to settle; this one takes 55 ms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from hilbridge.features.kalman import ConstantPositionFilter
from hilbridge.limits import GAZE_COAST_NS, SENSING_LIMIT_NS
from hilbridge.records import GazeSample

REFERENCE_PX = 1280.0
Q_PX2_PER_S = 4.0 / 0.005
R_PX2 = 60.0
CHI2_SACCADE = 16.0


@dataclass(frozen=True, slots=True)
class GazeState:
    """Smoothed gaze at one step: x, y in 0..1 of the picture, velocity per second, capture stamp of the sample used."""

    x: float
    y: float
    dx: float
    dy: float
    captured_ns: int


class GazeFilter:
    """One wearer's gaze. `update` once per step; None back means gaze is not valid at this step."""

    def __init__(self) -> None:
        self._filter: ConstantPositionFilter | None = None
        self._stepped_ns = 0
        self._seen_ns: int | None = None
        self._position: tuple[float, float] | None = None

    def reset(self) -> None:
        """Forget everything."""
        self.__init__()  # type: ignore[misc]

    def update(self, sample: GazeSample | None, now_ns: int) -> GazeState | None:
        """Advance to `now_ns` with the newest sample (or the same one again, or None: nothing new).

        Coasts through blinks of up to 100 ms; never lets a NaN, an infinity or a point far outside the picture in.
        """
        fresh = sample is not None and usable(sample, now_ns) and sample.captured_ns != self._seen_ns
        if self._seen_ns is not None and now_ns - self._seen_ns > GAZE_COAST_NS and not fresh:
            # The stamp stays: a frozen tracker's last sample must not count as a new one.
            self._filter = None
            self._position = None
            return None
        if self._filter is None:
            if sample is None or not fresh:
                return None
            self._start(sample, now_ns)
        else:
            self._filter.predict(max(0, now_ns - self._stepped_ns) * 1e-9)
            if fresh and sample is not None:
                self._measure(self._filter, sample)
        return self._state(now_ns)

    def _start(self, sample: GazeSample, now_ns: int) -> None:
        self._filter = _settled_at(sample)
        self._seen_ns = sample.captured_ns
        self._stepped_ns = now_ns

    def _measure(self, kalman: ConstantPositionFilter, sample: GazeSample) -> None:
        x_px, y_px = sample.x * REFERENCE_PX, sample.y * REFERENCE_PX
        if kalman.normalised_innovation_squared(x_px, y_px) > CHI2_SACCADE:
            self._filter = _settled_at(sample)
        else:
            kalman.update(x_px, y_px)
        self._seen_ns = sample.captured_ns

    def _state(self, now_ns: int) -> GazeState:
        assert self._filter is not None
        assert self._seen_ns is not None
        x, y = self._filter.x / REFERENCE_PX, self._filter.y / REFERENCE_PX
        elapsed_s = (now_ns - self._stepped_ns) * 1e-9
        dx = dy = 0.0
        if self._position is not None and elapsed_s > 1e-4:
            dx, dy = (x - self._position[0]) / elapsed_s, (y - self._position[1]) / elapsed_s
        self._position = (x, y)
        self._stepped_ns = now_ns
        return GazeState(x, y, dx, dy, self._seen_ns)


def usable(sample: GazeSample, now_ns: int) -> bool:
    """True for a finite, fresh sample that its tracker calls valid, within one picture of the picture."""
    return (
        sample.valid
        and math.isfinite(sample.x)
        and math.isfinite(sample.y)
        and -1.0 <= sample.x <= 2.0
        and -1.0 <= sample.y <= 2.0
        and now_ns - sample.captured_ns <= SENSING_LIMIT_NS
    )


def _settled_at(sample: GazeSample) -> ConstantPositionFilter:
    return ConstantPositionFilter(sample.x * REFERENCE_PX, sample.y * REFERENCE_PX, Q_PX2_PER_S, R_PX2)
