"""Tremor in the acceleration of a hand: whether it is there, and its frequency.

Pictures at 25 Hz cannot see 12 Hz; an inertial sensor at 60 Hz or more can. The last 1.28 s of each sensor, as far as they
came, whatever was lost between: trend taken off, windowed, and of all frequencies from 2.5 to 13 Hz the strongest peak taken
by its power over the three axes. Tremor is a line; reaching, lifting and putting down are broad, or slower than the band: what
only rises towards its lower edge is no peak.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hilbridge.limits import MS
from hilbridge.records import BodySample

WINDOW_NS = 1_280 * MS
EVERY_NS = 80 * MS  # a look costs half a millisecond, and tremor does not change sooner
LEAST_SPAN_NS = 640 * MS
LEAST_SAMPLES = 32
ON, OFF = 0.4, 0.3  # m/s^2, root mean square of the line: a steady hand has a tenth of it
ON_SHARE, OFF_SHARE = 0.5, 0.4  # of the band's power that lies in the line
_SILENT_NS = 500 * MS  # the rest of a window is of another moment
_DEGREE = 3  # of the trend: gravity turns with the hand, and reaching is slow
_STEP_HZ = 0.1
_FREQUENCIES = np.arange(2.5, 13.0 + _STEP_HZ / 2, _STEP_HZ)
_WIDTH_HZ = 2.0 / (WINDOW_NS * 1e-9)  # of a line in this window, to either side
_MOST_SAMPLES = 512


@dataclass(frozen=True, slots=True)
class Line:
    """The strongest line in a hand's acceleration: its frequency, its strength, its share of what is in the band."""

    hz: float
    rms: float
    share: float


class AccelerationGuard:
    """One wearer's hands. `update` with each sample; samples of sensors that are on no hand are not looked at.

    A sensor is on a hand where its name has `hand` in it.
    """

    def __init__(self) -> None:
        self._sensors: dict[str, _Sensor] = {}

    @property
    def trembling(self) -> bool:
        """Whether any hand trembles, as last looked at."""
        return any(sensor.trembling for sensor in tuple(self._sensors.values()))

    @property
    def heard_ns(self) -> int | None:
        """The stamp until which every hand that was ever felt has been; None before the first sample."""
        return min((sensor.heard_ns for sensor in tuple(self._sensors.values())), default=None)

    @property
    def line(self) -> Line | None:
        """The strongest line of all hands; None before the first look."""
        lines = [sensor.line for sensor in tuple(self._sensors.values()) if sensor.line is not None]
        return max(lines, key=lambda line: line.rms, default=None)

    def update(self, sample: BodySample) -> bool:
        """True while a hand trembles. Samples that are not valid, or not newer than the last one, tell nothing."""
        if sample.valid and is_hand(sample.sensor):
            sensor = self._sensors.get(sample.sensor) or _Sensor()
            sensor.update(sample)
            self._sensors[sample.sensor] = sensor  # another thread reads: only what has heard something
        return self.trembling


def is_hand(sensor: str) -> bool:
    """Whether a sensor of this name is on a hand."""
    return "hand" in sensor.lower()


class _Sensor:
    def __init__(self) -> None:
        self.trembling = False
        self.line: Line | None = None
        self.heard_ns = 0
        self._recent: deque[tuple[int, float, float, float]] = deque(maxlen=_MOST_SAMPLES)
        self._looked_ns: int | None = None

    def update(self, sample: BodySample) -> None:
        now_ns = sample.captured_ns
        if self._recent and now_ns <= self._recent[-1][0]:
            return
        self.heard_ns = now_ns
        if self._recent and now_ns - self._recent[-1][0] > _SILENT_NS:
            self._recent.clear()
        self._recent.append((now_ns, sample.x, sample.y, sample.z))
        while now_ns - self._recent[0][0] > WINDOW_NS:
            self._recent.popleft()
        if self._looked_ns is not None and 0 <= now_ns - self._looked_ns < EVERY_NS:
            return
        self._looked_ns = now_ns
        self.line = self._look()
        line = self.line
        on, share = (OFF, OFF_SHARE) if self.trembling else (ON, ON_SHARE)
        self.trembling = line is not None and line.rms > on and line.share > share

    def _look(self) -> Line | None:
        recent = self._recent
        if len(recent) < LEAST_SAMPLES or recent[-1][0] - recent[0][0] < LEAST_SPAN_NS:
            return None
        newest_ns = recent[-1][0]
        times_s = np.array([(row[0] - newest_ns) * 1e-9 for row in recent])
        return strongest_line(times_s, np.array([row[1:] for row in recent]))


def strongest_line(times_s: NDArray[np.float64], values: NDArray[np.float64]) -> Line | None:
    """Of (N,) times that increase and (N, 3) values at them, spaced as they may be; None where nothing stands out."""
    span_s = times_s[-1] - times_s[0]
    unit = 2.0 * (times_s - times_s[0]) / span_s - 1.0
    window = 0.5 + 0.5 * np.cos(np.pi * unit)
    # A gap of lost samples must not count for less than its time.
    weights = window * np.gradient(times_s)
    trend = np.vander(unit, _DEGREE + 1)
    root = np.sqrt(weights)[:, None]
    fitted, *_ = np.linalg.lstsq(trend * root, values * root, rcond=None)
    left = values - trend @ fitted
    wave = np.exp(-2j * np.pi * _FREQUENCIES[:, None] * times_s)
    power = (np.abs(wave @ (left * weights[:, None])) ** 2).sum(axis=1)
    rises = (power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])
    if not rises.any():
        return None
    peak = 1 + int(np.argmax(np.where(rises, power[1:-1], 0.0)))
    near = np.abs(_FREQUENCIES - _FREQUENCIES[peak]) <= _WIDTH_HZ
    total = float(power.sum())
    # A sine of amplitude A gives A / 2 times the window's sum.
    rms = float(np.sqrt(2.0 * power[peak]) / weights.sum())
    return Line(_refined(power, peak), rms, float(power[near].sum()) / total if total > 0.0 else 0.0)


def _refined(power: NDArray[np.float64], peak: int) -> float:
    """The top of the parabola through the peak and its neighbours."""
    at = float(_FREQUENCIES[peak])
    before, top, after = (float(power[index]) for index in (peak - 1, peak, peak + 1))
    bend = before - 2.0 * top + after
    return at if bend >= 0.0 else at + 0.5 * (before - after) / bend * _STEP_HZ
