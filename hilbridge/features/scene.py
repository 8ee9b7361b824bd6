"""Scene: compact HSV histograms of the whole picture and of a patch around the gaze (paper, "Inputs and Encoder").

The picture is shrunk first, so a step costs the same at 720p as at 240p. Hue counts by saturation times value: the hue
of a grey or a black pixel is noise. Shares are square-rooted (Hellinger), which keeps small colours visible.
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
# Neighbours count into tables of their own: adding to one number again and again waits for itself.
_TABLES = 4

Plane = NDArray[np.uint8] | NDArray[np.uint16]


def shrink(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(h, w, 3) -> every n-th row and column so that 72 to 143 rows stay.

    Taking pixels rather than averaging them invents no mixed hues at edges, so the histograms hardly depend on the
    camera's resolution, and it costs next to nothing at 720p. Raises ValueError for what is not an RGB picture.
    """
    if rgb.ndim != 3 or rgb.shape[2] != 3 or rgb.dtype != np.uint8 or min(rgb.shape[:2]) < 2:
        raise ValueError(f"picture of shape {rgb.shape} and type {rgb.dtype}: expected (height, width, 3) uint8")
    stride = max(1, rgb.shape[0] // HEIGHT_PX)
    return np.ascontiguousarray(rgb[stride // 2 :: stride, stride // 2 :: stride])


def histogram(hsv: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(h, w, 3) uint8 HSV -> (20,) float32: square roots of hue, saturation and value shares, each block's sum 1.

    A picture without any colour spreads the hue evenly rather than inventing one.
    """
    return np.asarray(_histograms([_planes(hsv)])[0])


def scene_features(
    rgb: NDArray[np.uint8], gaze: tuple[float, float] | None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Histograms of the whole picture and of the patch around `gaze` (0..1; None: the whole picture again)."""
    small = shrink(rgb)
    hsv = np.empty_like(small)
    cv2.cvtColor(small, cv2.COLOR_RGB2HSV, hsv)
    planes = _planes(hsv)
    if gaze is None:
        (frame,) = _histograms([planes])
        return frame, frame
    height, width = hsv.shape[:2]
    half = max(1, round(PATCH_SHARE * height))
    # A gaze outside the picture sees the nearest part of it.
    column = min(max(round(gaze[0] * width), half), max(half, width - half))
    row = min(max(round(gaze[1] * height), half), max(half, height - half))
    patch = slice(max(0, row - half), row + half), slice(max(0, column - half), column + half)
    whole, near = _histograms([planes, [plane[patch] for plane in planes]])
    return whole, near


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


def _histograms(areas: Sequence[Sequence[Plane]]) -> NDArray[np.float32]:
    """(n, 20), each area given by its planes."""
    shares = np.empty((len(areas), HISTOGRAM_BINS))
    tables = np.empty((len(areas), _TABLES, HUE_BINS))
    for row, table, (bins, weight, saturation, value) in zip(shares, tables, areas, strict=True):
        table.flat = np.bincount(bins.ravel(), weight.ravel(), table.size)
        row[HUE_BINS:] = _counts(saturation, _SATURATION_EDGES) + _counts(value, _VALUE_EDGES)
        row[HUE_BINS:] /= weight.size
    hues = tables.sum(axis=1)
    hues[~hues.any(axis=1)] = 1.0
    np.divide(hues, hues.sum(axis=1, keepdims=True), out=shares[:, :HUE_BINS])
    return np.sqrt(shares).astype(np.float32)


def _counts(plane: Plane, edges: NDArray[np.uint8]) -> list[int]:
    """How many pixels fall into each bin: from how many reach the edges between them."""
    reach = [plane.size, *map(np.count_nonzero, plane.ravel() >= edges), 0]
    return [reached - further for reached, further in pairwise(reach)]
