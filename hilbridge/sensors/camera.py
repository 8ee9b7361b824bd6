"""Pictures from a device index, a video file or a stream URL, each stamped once on the monotonic clock."""

from __future__ import annotations

import math
import os
import re
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import InputError
from hilbridge.records import CameraFrame, StampSource
from hilbridge.sensors.source import Source, SourceState

_RETRY_S = 0.5
_READS_BEFORE_GONE = 5
_OPEN_TIMEOUT_MS = 5_000
_LAST_CAMERA = 255
_FAR_OFF_NS = 1_000_000_000  # a stamp further back than this is no stamp of now
_REOPEN_TIMEOUT_MS = 2_000
_READ_TIMEOUT_MS = 1_000  # a stream whose connection died without closing is gone after this
_RATE_SAMPLE = 25  # pictures from whose stamps a file's rate is told where it does not say

# OpenCV and FFmpeg print to stderr what this module reports in one line of its own.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


def _numbered(spec: str) -> str:
    """A camera's path, as `v4l2-ctl --list-devices` prints it, is its number. Raises InputError for another device."""
    if (found := re.fullmatch(r"/dev/video(\d+)", spec)) is not None:
        spec = found[1]
    if spec.isdigit() and int(spec) > _LAST_CAMERA:
        raise InputError(f"camera {spec}: no such number; `v4l2-ctl --list-devices` lists cameras")
    if "://" not in spec and Path(spec).is_char_device():
        raise InputError(f"camera {spec}: is a device but no /dev/videoN; give a camera's number")
    return spec


class CameraSource(Source[CameraFrame]):
    """Reads `spec`: a device index ("0"), the path of a video file, or an rtsp:// or http:// URL.

    A file is played by its own stamps as if it were a camera (a Neon scene video by its `.time` file); `loop` starts it
    again at its end. `fps` plays it at
    that rate instead, and asks a device for it (`self.fps` is what it then says it does). A device or stream
    that goes away is tried again every half second and is GONE meanwhile. Pictures of a device have the driver's own stamp
    (`StampSource.HARDWARE`) where it gives one of this clock, else that of their arrival less `latency_ns`.

    Raises InputError when `spec` cannot be opened or gives no picture, or `fps` is wanted of a stream.
    """

    def __init__(
        self,
        spec: str,
        *,
        loop: bool = False,
        fps: float | None = None,
        latency_ns: int = 0,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        super().__init__(f"camera {spec}", clock_ns)
        self._spec = spec = _numbered(spec)
        self._is_device = spec.isdigit() or _is_character_device(spec)
        self._is_file = not self._is_device and "://" not in spec
        if fps is not None and "://" in spec:
            raise InputError(f"camera {spec}: a stream's rate is set where it is sent; leave --camera-fps out")
        self._wanted_fps = fps
        self._loop = loop
        self._latency_ns = latency_ns
        self._sequence = 0
        self._grabbed_ns, self._stamp = clock_ns(), StampSource.ARRIVAL
        self._capture, first = self._open_checked()
        self._first: NDArray[np.uint8] | None = first
        self.height, self.width = first.shape[:2]
        self.fps = self._own_fps()
        if fps is not None and self._is_file:
            self.fps = fps

    def _own_fps(self) -> float:
        """What the source says, else what the first stamps of a file say, else 30."""
        said = float(self._capture.get(cv2.CAP_PROP_FPS))
        if 1.0 <= said <= 240.0 or not self._is_file:
            return said if 1.0 <= said <= 240.0 else 30.0
        stamps: list[float] = []
        capture = self._open()
        while len(stamps) < _RATE_SAMPLE and capture.grab():
            stamps.append(float(capture.get(cv2.CAP_PROP_POS_MSEC)))
        capture.release()
        span_ms = stamps[-1] - stamps[0] if stamps else 0.0
        return min(240.0, max(1.0, (len(stamps) - 1) * 1000.0 / span_ms)) if span_ms > 0 else 30.0

    def _open(self, open_timeout_ms: int = _OPEN_TIMEOUT_MS) -> cv2.VideoCapture:
        if self._is_device:
            capture = cv2.VideoCapture(int(self._spec) if self._spec.isdigit() else self._spec, cv2.CAP_ANY)
            if self._wanted_fps is not None:
                capture.set(cv2.CAP_PROP_FPS, self._wanted_fps)
            return capture
        # FFmpeg's own threads would be ordinary ones: on a busy machine they starve behind the real-time threads that
        # wait for the picture, and the camera lags.
        options = [cv2.CAP_PROP_N_THREADS, 1]
        if not self._is_file:
            options += [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, open_timeout_ms]
            options += [cv2.CAP_PROP_READ_TIMEOUT_MSEC, _READ_TIMEOUT_MS]
        return cv2.VideoCapture(self._spec, cv2.CAP_FFMPEG, options)

    def _open_checked(self) -> tuple[cv2.VideoCapture, NDArray[np.uint8]]:
        if self._is_file and not Path(self._spec).is_file():
            raise InputError(
                f"camera {self._spec}: no such file; give a device (0 or /dev/video0), a video file or an rtsp:// URL"
            )
        capture = self._open()
        if not capture.isOpened():
            capture.release()
            cure = {
                True: "the file is no video that can be decoded; check it with `ffprobe`, or record it again",
                False: "is it connected and free? `v4l2-ctl --list-devices` lists cameras; a URL needs its host",
            }[self._is_file]
            raise InputError(f"camera {self._spec}: cannot be opened; {cure}")
        ok, picture = capture.read()
        if not ok or not _is_colour(picture):
            capture.release()
            raise InputError(f"camera {self._spec}: opened but gave no picture; the file or stream holds no video")
        return capture, np.asarray(picture, dtype=np.uint8)

    def _read_all(self) -> None:
        try:
            if self._is_file:
                self._play()
            else:
                self._capture_live()
        finally:
            self._capture.release()

    def _play(self) -> None:
        """A file by its own stamps. A picture counts as captured when it is due; its conversion is part of the latency."""
        stamps_ns = None if self._wanted_fps is not None else _neon_stamps_ns(Path(self._spec))
        while True:
            started_ns, played, first_ms, last_ns = self._clock_ns(), 0, 0.0, -1
            while self._first is not None or self._capture.grab():
                stamp_ms = float(self._capture.get(cv2.CAP_PROP_POS_MSEC))
                first_ms = stamp_ms if not played else first_ms
                given_ns = stamps_ns[played] if stamps_ns and played < len(stamps_ns) else None
                last_ns = self._offset_ns(played, stamp_ms - first_ms, given_ns, last_ns)
                played += 1
                if not self._sleep_until(started_ns + last_ns):
                    return
                self._show(started_ns + last_ns)
            if not self._loop or not played:
                return
            self._capture.release()
            self._capture = self._open()

    def _offset_ns(self, played: int, stamp_ms: float, given_ns: int | None, last_ns: int) -> int:
        """When the picture is due, from the first: as given, else by the file's stamp, else (no stamps) by the rate."""
        if given_ns is not None:
            return max(given_ns, last_ns + 1)
        stamp_ns = round(stamp_ms * 1e6) if math.isfinite(stamp_ms) else -1
        return stamp_ns if self._wanted_fps is None and stamp_ns > last_ns else round(played * 1e9 / self.fps)

    def _show(self, due_ns: int) -> None:
        """Hand on the picture that was grabbed, or count it as failed."""
        first, self._first = self._first, None
        ok, picture = (True, first) if first is not None else self._capture.retrieve()
        if ok and _is_colour(picture):
            self._deliver_picture(np.asarray(picture, np.uint8), due_ns)
        else:
            self.cell.fail()

    def _capture_live(self) -> None:
        failures = 0
        while not self._stopping.is_set():
            picture = self._next_picture()
            if picture is not None:
                failures = 0
                self._deliver_picture(picture, self._grabbed_ns)
                continue
            failures += 1
            self.cell.fail()
            # A stream's read has waited its time-out; a device may miss a picture now and then.
            if failures >= (_READS_BEFORE_GONE if self._is_device else 1) and not self._reopen():
                return

    def _deliver_picture(self, picture: NDArray[np.uint8], captured_ns: int) -> None:
        self._sequence += 1
        rgb = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8)
        self._deliver(CameraFrame(captured_ns, rgb, self._sequence, self._stamp), captured_ns)

    def _next_picture(self) -> NDArray[np.uint8] | None:
        """The next picture as BGR, or None where there is none to be had."""
        if self._first is not None:
            first, self._first = self._first, None
            return first
        if not self._capture.grab():
            return None
        said_ms = float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) if self._is_device else 0.0
        self._grabbed_ns, self._stamp = taken_at(said_ms, self._clock_ns(), self._latency_ns, self._grabbed_ns)
        ok, picture = self._capture.retrieve()
        return np.asarray(picture, np.uint8) if ok and _is_colour(picture) else None

    def _reopen(self) -> bool:
        """Try to get the device back until it works (True) or the source is to stop (False)."""
        self.state, self.detail = SourceState.GONE, "no pictures; trying to reopen"
        while not self._stopping.wait(_RETRY_S):
            self._capture.release()
            self._capture = self._open(_REOPEN_TIMEOUT_MS)
            if self._capture.isOpened():
                return True
        return False


def taken_at(said_ms: float, now_ns: int, latency_ns: int, last_ns: int) -> tuple[int, StampSource]:
    """When a picture was taken that has just come, and how that is known.

    V4L2 drivers stamp by the monotonic clock, or by one of their own: a stamp that lies ahead, more than a second back, or
    not after the last one is none. Stamps never go back.
    """
    if math.isfinite(said_ms):
        said_ns = round(said_ms * 1e6)
        if max(last_ns + 1, now_ns - _FAR_OFF_NS) <= said_ns <= now_ns:
            return said_ns, StampSource.HARDWARE
    return max(now_ns - latency_ns, min(last_ns + 1, now_ns)), StampSource.ARRIVAL


def _is_character_device(spec: str) -> bool:
    """Whether it is a device file such as /dev/video0."""
    try:
        return Path(spec).is_char_device()
    except OSError:
        return False


def _neon_stamps_ns(video: Path) -> list[int] | None:
    """When each picture of a Neon scene video was taken, from its first: the app writes that beside the video."""
    path = video.with_suffix(".time")
    if not path.is_file():
        return None
    data = path.read_bytes()
    stamps = np.frombuffer(data[: len(data) // 8 * 8], "<i8")
    return [int(stamp) for stamp in stamps - stamps[0]] if len(stamps) else None


def _is_colour(picture: object) -> bool:
    return isinstance(picture, np.ndarray) and picture.ndim == 3 and picture.shape[2] == 3 and picture.size > 0
