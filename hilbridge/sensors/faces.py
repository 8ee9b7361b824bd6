"""Blurs faces in pictures that are kept. The detector comes with scikit-image; nothing is fetched.

It is a cascade of local binary patterns for faces from the front (Zhang et al. 2007). It is quick to get and it misses faces
that are small, turned away, tilted or covered: that nothing is left to recognise is not promised (docs/privacy.md).
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import needs_extra

LOOK_WIDTH_PX = 200  # a face of a tenth of the picture's width is 20 pixels wide there, the least that is found
LOOK_EVERY = 4  # pictures; what was found in the last two looks stays blurred in between
_SMALLEST_PX = 20
_MARGIN = 0.35  # of the face's size, for hair, chin, and a head that moves between two looks
_BLOCKS = 5

Box = tuple[int, int, int, int]
Picture = NDArray[np.uint8]


class FaceBlur:
    """Blurs the faces of one stream of pictures, in their order."""

    def __init__(self) -> None:
        """Raises InputError where the detector is not installed."""
        with needs_extra("privacy"):
            import skimage.data
            import skimage.feature

        data: Any = skimage.data  # typed in parts only
        self._cascade: Any = skimage.feature.Cascade(data.lbp_frontal_face_cascade_filename())
        self._pictures = 0
        self._newest: list[Box] = []
        self._before: list[Box] = []

    def apply(self, rgb: Picture) -> Picture:
        """The picture (H, W, 3) with every known face and a margin about it as a few flat blocks."""
        if self._pictures % LOOK_EVERY == 0:
            self._before, self._newest = self._newest, self.faces(rgb)
        self._pictures += 1
        boxes = self._newest + self._before
        if not boxes:
            return rgb
        out = rgb.copy()
        for box in boxes:
            _blur(out, box)
        return out

    def faces(self, rgb: Picture) -> list[Box]:
        """x, y, width, height in pixels of every face that is found."""
        height_px, width_px = rgb.shape[:2]
        scale = min(1.0, LOOK_WIDTH_PX / width_px)
        small = cv2.resize(rgb, (max(1, round(width_px * scale)), max(1, round(height_px * scale))))
        largest_px = min(small.shape[:2])
        if largest_px < _SMALLEST_PX:
            return []
        found = self._cascade.detect_multi_scale(
            img=small,
            scale_factor=1.2,
            step_ratio=1,
            min_size=(_SMALLEST_PX, _SMALLEST_PX),
            max_size=(largest_px, largest_px),
        )
        return [
            (round(f["c"] / scale), round(f["r"] / scale), round(f["width"] / scale), round(f["height"] / scale))
            for f in found
        ]


def _blur(rgb: Picture, box: Box) -> None:
    x, y, width, height = box
    aside, above = round(_MARGIN * width), round(_MARGIN * height)
    part = rgb[max(0, y - above) : y + height + above, max(0, x - aside) : x + width + aside]
    if part.size:
        blocks = cv2.resize(part, (_BLOCKS, _BLOCKS), interpolation=cv2.INTER_AREA)
        part[:] = cv2.resize(blocks, (part.shape[1], part.shape[0]), interpolation=cv2.INTER_NEAREST)
