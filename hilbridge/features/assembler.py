"""Records in, one FeatureVector out, once per 25 Hz step (paper, "Inputs and Encoder").

Every modality has its own validity; what is not valid is zero, and no number that leaves here is NaN or infinite.
Time is an argument.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hilbridge.features.gaze import GazeFilter, GazeState
from hilbridge.features.hands import HandState, HandTracker
from hilbridge.features.layout import FRAME, GAZE, HANDS, PATCH, D
from hilbridge.features.scene import scene_features
from hilbridge.records import CameraFrame, FeatureVector, GazeSample, HandTracks

MAX_FRAME_AGE_NS = 150_000_000
LIMIT = 20.0  # picture widths per second; faster is a defect of the input, not a movement


class FeatureAssembler:
    """Holds the filters of one stream. `update` must be called with `now_ns` that never goes back."""

    def __init__(self) -> None:
        self._gaze = GazeFilter()
        self._hands = HandTracker()

    def reset(self) -> None:
        """Forget the past, as after a gap in the stream."""
        self._gaze.reset()
        self._hands.reset()

    def update(
        self, frame: CameraFrame | None, gaze: GazeSample | None, hands: HandTracks | None, now_ns: int
    ) -> FeatureVector:
        """Newest record of each kind -> features at `now_ns`, raw (not z-scored).

        `now_ns` is the moment that the step is of: live, the picture's own stamp, so that what is measured from the
        vector's `captured_ns` is the way from the picture. A record may be handed in again; what is older than 150 ms
        does not count. Raises ValueError only for a frame that is not an RGB picture.
        """
        values = np.zeros(D, dtype=np.float32)
        look = self._gaze.update(gaze, now_ns)
        slots = self._hands.update(hands, now_ns)
        seen = frame is not None and now_ns - frame.captured_ns <= MAX_FRAME_AGE_NS
        stamps: list[int] = []
        if look is not None:
            _write_gaze(values, look)
            stamps.append(look.captured_ns)
        if slots is not None and hands is not None:
            _write_hands(values, slots)
            stamps.append(hands.captured_ns)
        if seen and frame is not None:
            whole, patch = scene_features(frame.rgb, None if look is None else (look.x, look.y))
            values[FRAME] = whole
            values[PATCH] = patch
            stamps.append(frame.captured_ns)
        np.nan_to_num(values, copy=False, nan=0.0, posinf=LIMIT, neginf=-LIMIT)
        np.clip(values, -LIMIT, LIMIT, out=values)
        return FeatureVector(
            oldest_input_ns=min(stamps, default=now_ns),
            captured_ns=now_ns,
            values=values,
            valid=(look is not None, slots is not None and hands is not None, bool(seen)),
        )


def _write_gaze(values: NDArray[np.float32], look: GazeState) -> None:
    values[GAZE] = (look.x, look.y, 1.0, look.dx, look.dy)


def _write_hands(values: NDArray[np.float32], slots: tuple[HandState | None, ...]) -> None:
    block = values[HANDS].reshape(len(slots), 5)
    for row, state in zip(block, slots, strict=True):
        if state is not None:
            row[:] = (1.0, state.x, state.y, state.vx, state.vy)
