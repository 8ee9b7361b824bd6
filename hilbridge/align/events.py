"""Moments in recorded signals by which two clocks can be laid over each other: flashes, saccades, claps. Pure.

Times are (N,) nanoseconds that increase; each function gives the moments, as nanoseconds too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Times = NDArray[np.int64]
Numbers = NDArray[np.float64]

_FLASH_RISE = 25.0  # of 255, mean over the picture, from one picture to the next but one
_APART_NS = 400_000_000  # two events of one kind are no nearer
_SACCADE_SPEED = 0.8  # picture widths per second: eyes that follow something are slower
_SACCADE_LENGTH = 0.08  # picture widths
_SACCADE_NS = 120_000_000  # the longest saccade takes less
_IMPACT = 15.0  # m/s^2 away from the median within the quarter second around
_IMPACT_NS = 250_000_000
_TOUCH = 0.25  # picture widths between two palms that clap, at most
_CLOSING = 0.6  # picture widths per second at which palms come together


def flashes(times_ns: Times, brightness: Numbers) -> Times:
    """When pictures became brighter at once: between two pictures. brightness: mean of a picture, 0..255."""
    if len(times_ns) < 3:
        return np.empty(0, np.int64)
    rise = np.concatenate([[0.0], np.diff(brightness)])
    over_two = rise + np.concatenate([rise[1:], [0.0]])  # a flash may begin in the middle of an exposure
    lit = np.flatnonzero((over_two > _FLASH_RISE) & (rise > _FLASH_RISE / 4))
    return _first_of_each((times_ns[lit] + times_ns[lit - 1]) // 2, np.arange(len(lit)))


def saccades(times_ns: Times, x: Numbers, y: Numbers) -> Times:
    """When quick movements of the eye began. Samples that are not valid are left out before."""
    if len(times_ns) < 4:
        return np.empty(0, np.int64)
    elapsed_s = np.diff(times_ns) * 1e-9
    speed = np.hypot(np.diff(x), np.diff(y)) / np.maximum(elapsed_s, 1e-4)
    found = []
    for index in np.flatnonzero(speed > _SACCADE_SPEED).tolist():
        end = int(np.searchsorted(times_ns, times_ns[index] + _SACCADE_NS, side="right")) - 1
        if np.hypot(x[end] - x[index], y[end] - y[index]) >= _SACCADE_LENGTH:
            found.append(index)
    return _first_of_each(times_ns, np.array(found, np.int64))


def impacts(times_ns: Times, acceleration: Numbers) -> Times:
    """When a hand was struck: the sharpest moment of each. acceleration: (N, 3) in m/s^2."""
    if len(times_ns) < 8:
        return np.empty(0, np.int64)
    size = np.linalg.norm(acceleration, axis=1)
    half = max(1, round(_IMPACT_NS / 2 / max(1, int(np.median(np.diff(times_ns))))))
    padded = np.pad(size, half, mode="edge")
    rest = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=1)
    return _highest_of_each(times_ns, np.abs(size - rest), _IMPACT)


def claps(times_ns: Times, apart: Numbers) -> Times:
    """When two palms met. apart: their distance in picture widths, nan where not both are seen.

    Palms come together and part at a steady speed, so the moment is where the line through the last pictures of closing meets
    the one through the first of parting: finer than the pictures are apart.
    """
    seen = np.flatnonzero(np.isfinite(apart))
    found: list[int] = []
    for place in range(2, len(seen) - 2):
        first, before, at, after, last = seen[place - 2 : place + 3].tolist()
        if apart[at] > _TOUCH or apart[at] > apart[before] or apart[at] >= apart[after]:
            continue
        closing = float(apart[first] - apart[before]) / int(times_ns[before] - times_ns[first])
        parting = float(apart[last] - apart[after]) / int(times_ns[last] - times_ns[after])
        if closing * 1e9 < _CLOSING or parting <= 0.0:
            continue
        between_ns = int(times_ns[after] - times_ns[before])
        met_ns = (float(apart[before] - apart[after]) + parting * between_ns) / (closing + parting)
        found.append(int(times_ns[before]) + round(min(max(met_ns, 0.0), between_ns)))
    moments = np.array(found, np.int64)
    return _first_of_each(moments, np.arange(len(moments)))


def _first_of_each(times_ns: Times, indices: NDArray[np.int64]) -> Times:
    kept: list[int] = []
    for moment in times_ns[indices].tolist():
        if not kept or moment - kept[-1] >= _APART_NS:
            kept.append(moment)
    return np.array(kept, np.int64)


def _highest_of_each(times_ns: Times, size: Numbers, least: float) -> Times:
    kept: list[int] = []
    for index in np.argsort(-size, kind="stable").tolist():
        if size[index] < least:
            break
        moment = int(times_ns[index])
        if all(abs(moment - other) >= _APART_NS for other in kept):
            kept.append(moment)
    return np.array(sorted(kept), np.int64)
