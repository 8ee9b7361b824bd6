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
from numpy.typing import NDArray

from hilbridge.errors import InputError, needs_extra
from hilbridge.records import CameraFrame, Hand, HandTracks
from hilbridge.sensors.models import load_hand_model

ALONE_PICTURES = 10  # with one hand, before one is looked for
LOOK_EVERY = 5  # pictures between two looks for a second hand: a hand coasts that long
# Landmarks whose mean is the palm's centre: wrist and the five finger bases.
_PALM = (0, 1, 5, 9, 13, 17)


class HandCount:
    """How many hands to look for.

    With one of two in sight MediaPipe looks for the other in every picture, which takes as long as all the rest. So after a
    while of one hand one is looked for, and two again now and then. Each graph follows hands by itself and may lose one that
    the other still has: a picture that shows none after one that did is asked of both. Pure.
    """

    def __init__(self) -> None:
        self._alone = 0  # pictures in a row with one hand
        self._had = False

    @property
    def wanted(self) -> int:
        return 1 if self._alone >= ALONE_PICTURES and self._alone % LOOK_EVERY else 2

    def asks_again(self, hands: int) -> bool:
        """Whether the other graph has to say what is in this picture, too."""
        return hands == 0 and self._had

    def saw(self, hands: int) -> None:
        """How many the picture showed in the end."""
        self._had = hands > 0
        self._alone = self._alone + 1 if hands == 1 else 0


class HandDetector:
    """Finds up to two hands in pictures given in order of time. Use as a context manager; `close()` frees the graphs.

    `adaptive`: as many as `HandCount` says. Raises InputError when the extra or the model is absent, or the model is another
    one (`sha256`: one's own).
    """

    def __init__(
        self, model: Path, *, sha256: str | None = None, adaptive: bool = True, min_score: float = 0.5
    ) -> None:
        content = load_hand_model(model, sha256)
        with needs_extra("hands"), _quiet_stderr():
            import mediapipe as mp
        vision = mp.tasks.vision
        self._image_type = mp.Image
        self._image_format = mp.ImageFormat.SRGB
        self._last_ms = -1
        self._count = HandCount()
        self._landmarkers: dict[int, Any] = {}
        try:
            with _quiet_stderr():
                for count in (2, 1) if adaptive else (2,):
                    options = vision.HandLandmarkerOptions(
                        base_options=mp.tasks.BaseOptions(model_asset_buffer=content),
                        running_mode=vision.RunningMode.VIDEO,
                        num_hands=count,
                        min_hand_detection_confidence=min_score,
                    )
                    self._landmarkers[count] = vision.HandLandmarker.create_from_options(options)
                    # The first picture costs twice the time of the next: better one that nobody waits for.
                    self._find(count, np.zeros((72, 128, 3), np.uint8), self._last_ms + 1)
                    self._last_ms += 1
        except (RuntimeError, ValueError) as error:
            raise InputError(
                f"hand model {model}: mediapipe cannot load it ({str(error).splitlines()[0]}); "
                "run `hilbridge fetch-models --force`"
            ) from None

    @property
    def wanted(self) -> int:
        """How many hands the next picture is asked for."""
        return self._count.wanted if len(self._landmarkers) > 1 else 2

    def detect(self, frame: CameraFrame) -> HandTracks:
        """Hands in one picture. MediaPipe wants stamps that increase strictly, in milliseconds."""
        # A strided view would be misread without an error.
        rgb = np.ascontiguousarray(frame.rgb)
        stamp_ms = max(frame.captured_ns // 1_000_000, self._last_ms + 1)
        self._last_ms = stamp_ms
        wanted = self.wanted
        result = self._find(wanted, rgb, stamp_ms)
        if len(self._landmarkers) > 1 and self._count.asks_again(len(result.hand_landmarks)):
            result = self._find(3 - wanted, rgb, stamp_ms)
        self._count.saw(len(result.hand_landmarks))
        hands = []
        for landmarks, handedness in zip(result.hand_landmarks, result.handedness, strict=True):
            x = sum(landmarks[index].x for index in _PALM) / len(_PALM)
            y = sum(landmarks[index].y for index in _PALM) / len(_PALM)
            points = tuple(number for point in landmarks for number in (float(point.x), float(point.y), float(point.z)))
            hands.append(Hand(float(x), float(y), float(handedness[0].score), points))
        return HandTracks(frame.captured_ns, tuple(hands))

    def _find(self, count: int, rgb: NDArray[np.uint8], stamp_ms: int) -> Any:
        image = self._image_type(image_format=self._image_format, data=rgb)
        return self._landmarkers[count].detect_for_video(image, stamp_ms)

    def close(self) -> None:
        for landmarker in self._landmarkers.values():
            landmarker.close()
        self._landmarkers.clear()

    def __enter__(self) -> HandDetector:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def open_detector(model: Path, sha256: str | None) -> HandDetector:
    """A detector, as another process makes it."""
    return HandDetector(model, sha256=sha256)


def open_own_detector(spec: str) -> Any:
    """A detector of one's own (`package.module:Name`), as another process makes it. Raises InputError."""
    from hilbridge.sensors.live.plugins import called

    made = called("hand_detector", spec)
    if not callable(getattr(made, "detect", None)):
        raise InputError(f"hand_detector {spec}: makes a {type(made).__name__} without `detect(frame)` (docs/api.md)")
    return made


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
