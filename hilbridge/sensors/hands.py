"""MediaPipe's hand landmarker on single pictures (Tasks API, VIDEO mode): one detector, used from one thread only.

Needs the extra `hands` and the model that `hilbridge fetch-models` stores; nothing is downloaded here.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from hilbridge.errors import InputError, needs_extra
from hilbridge.records import CameraFrame, Hand, HandTracks
from hilbridge.sensors.models import load_hand_model

# Landmarks whose mean is the palm's centre: wrist and the five finger bases.
_PALM = (0, 1, 5, 9, 13, 17)


class HandDetector:
    """Finds up to two hands in pictures given in order of time. Use as a context manager; `close()` frees the graph.

    Raises InputError when the extra or the model is absent, or the model is another one (`sha256`: one's own).
    """

    def __init__(self, model: Path, *, sha256: str | None = None, max_hands: int = 2, min_score: float = 0.5) -> None:
        content = load_hand_model(model, sha256)
        with needs_extra("hands"), _quiet_stderr():
            import mediapipe as mp
        vision = mp.tasks.vision
        options = vision.HandLandmarkerOptions(
            base_options=mp.tasks.BaseOptions(model_asset_buffer=content),
            running_mode=vision.RunningMode.VIDEO,
            num_hands=max_hands,
            min_hand_detection_confidence=min_score,
        )
        self._image_type = mp.Image
        self._image_format = mp.ImageFormat.SRGB
        self._last_ms = -1
        try:
            with _quiet_stderr():
                self._landmarker: Any = vision.HandLandmarker.create_from_options(options)
                # The first picture costs twice the time of the next: better one that nobody waits for.
                self.detect(CameraFrame(0, np.zeros((72, 128, 3), np.uint8), 0))
        except (RuntimeError, ValueError) as error:
            raise InputError(
                f"hand model {model}: mediapipe cannot load it ({str(error).splitlines()[0]}); "
                "run `hilbridge fetch-models --force`"
            ) from None

    def detect(self, frame: CameraFrame) -> HandTracks:
        """Hands in one picture. MediaPipe wants stamps that increase strictly, in milliseconds."""
        # A strided view would be misread without an error.
        rgb = np.ascontiguousarray(frame.rgb)
        stamp_ms = max(frame.captured_ns // 1_000_000, self._last_ms + 1)
        self._last_ms = stamp_ms
        result = self._landmarker.detect_for_video(
            self._image_type(image_format=self._image_format, data=rgb), stamp_ms
        )
        hands = []
        for landmarks, handedness in zip(result.hand_landmarks, result.handedness, strict=True):
            x = sum(landmarks[index].x for index in _PALM) / len(_PALM)
            y = sum(landmarks[index].y for index in _PALM) / len(_PALM)
            points = tuple(number for point in landmarks for number in (float(point.x), float(point.y), float(point.z)))
            hands.append(Hand(float(x), float(y), float(handedness[0].score), points))
        return HandTracks(frame.captured_ns, tuple(hands))

    def close(self) -> None:
        self._landmarker.close()

    def __enter__(self) -> HandDetector:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def open_detector(model: Path, sha256: str | None) -> HandDetector:
    """A detector, as another process makes it."""
    return HandDetector(model, sha256=sha256)


@contextlib.contextmanager
def _quiet_stderr() -> Iterator[None]:
    """MediaPipe's C++ side logs its start to file descriptor 2 and offers no switch."""
    saved = os.dup(2)
    try:
        with Path(os.devnull).open("wb") as null:
            os.dup2(null.fileno(), 2)
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
