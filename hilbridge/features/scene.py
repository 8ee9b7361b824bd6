"""Scene: compact HSV histograms of the whole picture and of a patch around the gaze (paper, "Inputs and Encoder").

The picture is shrunk first, so a step costs the same at 720p as at 240p. Hue counts by saturation times value: the hue
of a grey or a black pixel is noise. Shares are square-rooted (Hellinger), which keeps small colours visible.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from hilbridge.features.layout import HUE_BINS, SATURATION_BINS, VALUE_BINS

HEIGHT_PX = 72
PATCH_SHARE = 0.16  # half of the patch's side over the picture's height

# One look-up from an 8-bit channel to its bin; OpenCV's hue runs from 0 to 179.
_HUE_BIN = np.minimum(np.arange(256) * HUE_BINS // 180, HUE_BINS - 1).astype(np.intp)


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
    weight = hsv[..., 1].astype(np.float64).ravel() * hsv[..., 2].ravel()
    total = float(weight.sum())
    if total > 0.0:
        hues = np.bincount(_HUE_BIN[hsv[..., 0].ravel()], weights=weight, minlength=HUE_BINS) / total
    else:
        hues = np.full(HUE_BINS, 1.0 / HUE_BINS)
    count = weight.size
    saturations = cv2.calcHist([hsv], [1], None, [SATURATION_BINS], [0, 256]).ravel() / count
    values = cv2.calcHist([hsv], [2], None, [VALUE_BINS], [0, 256]).ravel() / count
    return np.asarray(np.sqrt(np.concatenate([hues, saturations, values])), dtype=np.float32)


def scene_features(
    rgb: NDArray[np.uint8], gaze: tuple[float, float] | None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Histograms of the whole picture and of the patch around `gaze` (0..1; None: the whole picture again)."""
    hsv = cv2.cvtColor(shrink(rgb), cv2.COLOR_RGB2HSV).astype(np.uint8, copy=False)
    frame = histogram(hsv)
    if gaze is None:
        return frame, frame
    height, width = hsv.shape[:2]
    half = max(1, round(PATCH_SHARE * height))
    # A gaze outside the picture sees the nearest part of it.
    column = min(max(round(gaze[0] * width), half), max(half, width - half))
    row = min(max(round(gaze[1] * height), half), max(half, height - half))
    patch = hsv[max(0, row - half) : row + half, max(0, column - half) : column + half]
    return frame, histogram(patch)
