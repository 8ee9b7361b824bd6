"""Records in, one FeatureVector out, once per 25 Hz step (paper, "Inputs and Encoder").

Every modality has its own validity; what is not valid is zero, and no number that leaves here is NaN or infinite.
Time is an argument.
"""

from __future__ import annotations

import math

import numpy as np

from hilbridge.features.gaze import GazeFilter
from hilbridge.features.hands import HandState, HandTracker
from hilbridge.features.layout import FRAME, GAZE, HANDS, PATCH, D
from hilbridge.features.scene import scene_features
from hilbridge.limits import SENSING_LIMIT_NS
from hilbridge.records import CameraFrame, FeatureVector, GazeSample, HandTracks

_NO_HAND = (0.0,) * 5
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
        seen = frame is not None and now_ns - frame.captured_ns <= SENSING_LIMIT_NS
        stamps: list[int] = []
        if look is not None:
            values[GAZE] = _limited(look.x, look.y, 1.0, look.dx, look.dy)
            stamps.append(look.captured_ns)
        if slots is not None and hands is not None:
            values[HANDS] = [number for state in slots for number in _of_hand(state)]
            stamps.append(hands.captured_ns)
        if seen and frame is not None:
            whole, patch = scene_features(frame.pixels, None if look is None else (look.x, look.y), frame.palette)
            values[FRAME] = whole
            values[PATCH] = patch
            stamps.append(frame.captured_ns)
        return FeatureVector(
            oldest_input_ns=min(stamps, default=now_ns),
            captured_ns=now_ns,
            values=values,
            valid=(look is not None, slots is not None and hands is not None, bool(seen)),
        )


def _of_hand(state: HandState | None) -> tuple[float, ...]:
    return _NO_HAND if state is None else _limited(1.0, state.x, state.y, state.vx, state.vy)


def _limited(*numbers: float) -> tuple[float, ...]:
    """Within the limit, and zero for what is no number: no filter gives that, but nothing may ever get out of here."""
    return tuple([number if -LIMIT <= number <= LIMIT else _limit_of(number) for number in numbers])


def _limit_of(number: float) -> float:
    return 0.0 if math.isnan(number) else math.copysign(LIMIT, number)
