"""Scene: compact HSV histograms of the whole picture and of a patch around the gaze (paper, "Inputs and Encoder").

The picture is shrunk first, so a step costs the same at 720p as at 240p. Hue counts by saturation times value: the hue
of a grey or a black pixel is noise. Shares are square-rooted (Hellinger), which keeps small colours visible.

A drawn picture has a palette: there it is enough to count how often each colour occurs, which gives the same numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from hilbridge.features.layout import HISTOGRAM_BINS, HUE_BINS, SATURATION_BINS, VALUE_BINS

HEIGHT_PX = 72
PATCH_SHARE = 0.16  # half of the patch's side over the picture's height

# One look-up from an 8-bit channel to its bin; OpenCV's hue runs from 0 to 179.
_HUE_BIN = np.minimum(np.arange(256) * HUE_BINS // 180, HUE_BINS - 1).astype(np.uint8)
# The edges between the bins of a channel, one below the other.
_SATURATION_EDGES = (np.arange(1, SATURATION_BINS) * 256 // SATURATION_BINS).astype(np.uint8)[:, None]
_VALUE_EDGES = (np.arange(1, VALUE_BINS) * 256 // VALUE_BINS).astype(np.uint8)[:, None]
# Partial histograms of their own avoid a store-to-load dependency: neighbouring pixels often have the same colour.
_TABLES = 4

Plane = NDArray[np.uint8] | NDArray[np.uint16]


def shrink(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(h, w, 3) or (h, w) -> every n-th row and column so that 72 to 143 rows stay.

    Taking pixels rather than averaging them invents no mixed hues at edges, so the histograms hardly depend on the
    camera's resolution, and it costs next to nothing at 720p.
    """
    stride = max(1, pixels.shape[0] // HEIGHT_PX)
    return np.ascontiguousarray(pixels[stride // 2 :: stride, stride // 2 :: stride])


def histogram(hsv: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(h, w, 3) uint8 HSV -> (20,) float32: square roots of hue, saturation and value shares, each block's sum 1.

    A picture without any colour spreads the hue evenly rather than inventing one.
    """
    return np.asarray(_rooted_shares(_sums([_planes(hsv)]))[0])


def scene_features(
    pixels: NDArray[np.uint8], gaze: tuple[float, float] | None, palette: NDArray[np.uint8] | None = None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Histograms of the whole picture and of the patch around `gaze` (0..1; None: the whole picture again).

    pixels and palette as in `CameraFrame`. Raises ValueError for what is no such picture.
    """
    _check(pixels, palette)
    small = shrink(pixels)
    areas = [(slice(None), slice(None))]
    if gaze is not None:
        areas.append(_patch(gaze, *small.shape[:2]))
    if palette is None:
        hsv = np.empty_like(small)
        cv2.cvtColor(small, cv2.COLOR_RGB2HSV, hsv)
        planes = _planes(hsv)
        sums = _sums([[plane[area] for plane in planes] for area in areas])
    else:
        counts = [np.bincount(small[area].ravel(), minlength=len(palette)) for area in areas]
        sums = np.array(counts, dtype=np.float64) @ _sums_of_colours(palette.tobytes())
    made = _rooted_shares(sums)
    return made[0], made[-1]


def _check(pixels: NDArray[np.uint8], palette: NDArray[np.uint8] | None) -> None:
    channels = (3,) if palette is None else ()
    if (
        pixels.ndim != 2 + len(channels)
        or pixels.shape[2:] != channels
        or pixels.dtype != np.uint8
        or min(pixels.shape[:2]) < 2
    ):
        raise ValueError(
            f"picture of shape {pixels.shape} and type {pixels.dtype}: expected {('height', 'width', *channels)} uint8"
        )


def _patch(gaze: tuple[float, float], height: int, width: int) -> tuple[slice, slice]:
    half = max(1, round(PATCH_SHARE * height))
    # A gaze outside the picture sees the nearest part of it.
    column = min(max(round(gaze[0] * width), half), max(half, width - half))
    row = min(max(round(gaze[1] * height), half), max(half, height - half))
    return slice(max(0, row - half), row + half), slice(max(0, column - half), column + half)


def _planes(hsv: NDArray[np.uint8]) -> Sequence[Plane]:
    """What every pixel adds where: its hue's bin (and table), the weight of its hue, saturation, value."""
    # Into numpy's arrays: OpenCV takes as long to make its own. `cv2.split` writes past the cache, whence all is read next.
    hue, saturation, value, bins = np.empty((4, *hsv.shape[:2]), dtype=np.uint8)
    cv2.mixChannels([hsv], [hue, saturation, value], [0, 0, 1, 1, 2, 2])
    cv2.LUT(hue, _HUE_BIN, bins)
    bins += _tables(hsv.shape[1])
    return bins, np.multiply(saturation, value, dtype=np.uint16), saturation, value


@lru_cache(maxsize=4)
def _tables(width: int) -> NDArray[np.uint8]:
    """Where the table of each column begins."""
    return (np.arange(width) % _TABLES * HUE_BINS).astype(np.uint8)


def _sums(areas: Sequence[Sequence[Plane]]) -> NDArray[np.float64]:
    """Areas given by their planes -> (n, 20): weight of each hue, pixels of each saturation, of each value."""
    sums = np.empty((len(areas), HISTOGRAM_BINS))
    for row, (bins, weight, saturation, value) in zip(sums, areas, strict=True):
        tables = np.bincount(bins.ravel(), weight.ravel(), _TABLES * HUE_BINS)
        np.sum(tables.reshape(_TABLES, HUE_BINS), axis=0, out=row[:HUE_BINS])
        row[HUE_BINS:] = _counts(saturation, _SATURATION_EDGES) + _counts(value, _VALUE_EDGES)
    return sums


def _counts(plane: Plane, edges: NDArray[np.uint8]) -> list[int]:
    """How many pixels fall into each bin: from how many reach the edges between them."""
    reach = [plane.size, *[int(np.count_nonzero(row)) for row in plane.ravel() >= edges], 0]
    return [reached - further for reached, further in pairwise(reach)]


@lru_cache(maxsize=32)
def _sums_of_colours(palette: bytes) -> NDArray[np.float64]:
    """RGB bytes -> (n, 20): what one pixel of each colour adds to the sums."""
    colours = np.frombuffer(palette, dtype=np.uint8).reshape(1, -1, 3)
    planes = _planes(cv2.cvtColor(colours, cv2.COLOR_RGB2HSV).astype(np.uint8, copy=False))
    return _sums([[plane[:, column] for plane in planes] for column in range(colours.shape[1])])


def _rooted_shares(sums: NDArray[np.float64]) -> NDArray[np.float32]:
    """Sums (n, 20), which are used up -> square roots of each block's shares."""
    hues, counts = sums[:, :HUE_BINS], sums[:, HUE_BINS:]
    hues[~hues.any(axis=1)] = 1.0
    hues /= hues.sum(axis=1, keepdims=True)
    counts /= counts[:, :SATURATION_BINS].sum(axis=1, keepdims=True)
    return np.sqrt(sums).astype(np.float32)
