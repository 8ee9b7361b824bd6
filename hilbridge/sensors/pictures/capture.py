"""What reads pictures: OpenCV or PyAV, behind one small set of calls."""

from __future__ import annotations

import os
from enum import StrEnum
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

# OpenCV and FFmpeg print to stderr what the camera reports in one line of its own.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


class Reader(StrEnum):
    """AUTO: PyAV for streams, where it is installed; OpenCV for everything else (decision 323)."""

    AUTO = "auto"
    PYAV = "pyav"
    OPENCV = "opencv"


class Kind(StrEnum):
    DEVICE = "device"
    FILE = "file"
    STREAM = "stream"


class Capture(Protocol):
    """One open source of pictures; not open where `is_open` is False.

    `stamp_ms` is of the picture that was grabbed, by the file's or the driver's time; nan where there is none. `sender_ns` is
    its wall clock at the sender, where RTCP says it.
    """

    sender_ns: int | None

    @property
    def is_open(self) -> bool: ...

    @property
    def fps(self) -> float:
        """What the source says of its rate, whatever that is worth."""

    @property
    def stamp_ms(self) -> float: ...

    def grab(self) -> bool:
        """Wait for the next picture; False where none is to be had."""

    def retrieve(self) -> NDArray[np.uint8] | None:
        """The grabbed picture as RGB; None where it does not decode."""

    def release(self) -> None: ...


class OpenCvCapture:
    """`fps`: asked of a device. Time-outs are of streams."""

    def __init__(self, spec: str, kind: Kind, *, fps: float | None, open_ms: int, read_ms: int) -> None:
        self.sender_ns: int | None = None
        if kind is Kind.DEVICE:
            self._capture = cv2.VideoCapture(int(spec) if spec.isdigit() else spec, cv2.CAP_ANY)
            if fps is not None:
                self._capture.set(cv2.CAP_PROP_FPS, fps)
            return
        # FFmpeg's own threads would be ordinary ones: on a busy machine they starve behind the real-time threads that
        # wait for the picture, and the camera lags.
        options = [cv2.CAP_PROP_N_THREADS, 1]
        if kind is Kind.STREAM:
            options += [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, open_ms, cv2.CAP_PROP_READ_TIMEOUT_MSEC, read_ms]
        self._capture = cv2.VideoCapture(spec, cv2.CAP_FFMPEG, options)

    @property
    def is_open(self) -> bool:
        return self._capture.isOpened()

    @property
    def fps(self) -> float:
        return float(self._capture.get(cv2.CAP_PROP_FPS))

    @property
    def stamp_ms(self) -> float:
        return float(self._capture.get(cv2.CAP_PROP_POS_MSEC))

    def grab(self) -> bool:
        return bool(self._capture.grab())

    def retrieve(self) -> NDArray[np.uint8] | None:
        ok, picture = self._capture.retrieve()
        if not ok or not isinstance(picture, np.ndarray) or picture.ndim != 3 or picture.shape[2] != 3:
            return None
        return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8) if picture.size else None

    def release(self) -> None:
        self._capture.release()
