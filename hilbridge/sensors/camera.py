"""Pictures from a device index, a video file or a stream URL, each stamped once on the monotonic clock."""

from __future__ import annotations

import importlib.util
import math
import re
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import InputError
from hilbridge.records import CameraFrame, StampSource
from hilbridge.sensors.clock import DeviceClock
from hilbridge.sensors.pictures.capture import Capture, Kind, OpenCvCapture, Reader
from hilbridge.sensors.pictures.stamps import SenderStamps, taken_at
from hilbridge.sensors.source import Source, SourceState, begins_again_ns

_RETRIES_S = (0.5, 0.5, 1.0, 2.0, 4.0)  # pauses before a device or stream is tried again; the last one stays
_READS_BEFORE_GONE = 5
_OPEN_TIMEOUT_MS = 5_000
_LAST_CAMERA = 255
_REOPEN_TIMEOUT_MS = 2_000
_READ_TIMEOUT_MS = 1_000  # a stream whose connection died without closing is gone after this
_RATE_SAMPLE = 25  # pictures from whose stamps a file's rate is told where it does not say


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
    that goes away is tried again and again, with growing pauses, and is GONE meanwhile. Pictures of a device have the
    driver's own stamp (`StampSource.HARDWARE`) where it gives one of this clock, those of a stream the sender's
    (`StampSource.RTCP`) where its reports say it; else that of their arrival less `latency_ns`. `clock` knows the sender's
    clock, where somebody asks it.

    Raises InputError when `spec` cannot be opened or gives no picture, or `fps` is wanted of a stream.
    """

    def __init__(
        self,
        spec: str,
        *,
        loop: bool = False,
        fps: float | None = None,
        latency_ns: int = 0,
        reader: Reader = Reader.AUTO,
        clock: DeviceClock | None = None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        super().__init__(f"camera {spec}", clock_ns)
        self._spec = spec = _numbered(spec)
        self._kind = _kind(spec)
        self._reader = reader
        if fps is not None and "://" in spec:
            raise InputError(f"camera {spec}: a stream's rate is set where it is sent; leave --camera-fps out")
        self._wanted_fps = fps
        self._loop = loop
        self._latency_ns = latency_ns
        self._sender = SenderStamps(clock)
        self._sequence = 0
        self._grabbed_ns, self._stamp = clock_ns(), StampSource.ARRIVAL
        self._reopened = 0  # since the last picture
        self._capture, first = self._open_checked()
        self._first: NDArray[np.uint8] | None = first
        self.height, self.width = first.shape[:2]
        self.fps = self._own_fps()
        if fps is not None and self._kind is Kind.FILE:
            self.fps = fps

    def _own_fps(self) -> float:
        """What the source says, else what the first stamps of a file say, else 30."""
        said = self._capture.fps
        if 1.0 <= said <= 240.0 or self._kind is not Kind.FILE:
            return said if 1.0 <= said <= 240.0 else 30.0
        stamps: list[float] = []
        capture = self._open()
        while len(stamps) < _RATE_SAMPLE and capture.grab():
            stamps.append(capture.stamp_ms)
        capture.release()
        span_ms = stamps[-1] - stamps[0] if stamps else 0.0
        return min(240.0, max(1.0, (len(stamps) - 1) * 1000.0 / span_ms)) if span_ms > 0 else 30.0

    def _open(self, open_ms: int = _OPEN_TIMEOUT_MS) -> Capture:
        wants_pyav = self._reader is Reader.PYAV
        if self._reader is Reader.AUTO and self._kind is Kind.STREAM:
            wants_pyav = importlib.util.find_spec("av") is not None
        if wants_pyav:
            from hilbridge.sensors.pictures.pyav import PyAvCapture

            opened: Capture = PyAvCapture(
                self._spec, self._kind, fps=self._wanted_fps, open_ms=open_ms, read_ms=_READ_TIMEOUT_MS
            )
            if opened.is_open or self._reader is Reader.PYAV:
                return opened
        return OpenCvCapture(self._spec, self._kind, fps=self._wanted_fps, open_ms=open_ms, read_ms=_READ_TIMEOUT_MS)

    def _open_checked(self) -> tuple[Capture, NDArray[np.uint8]]:
        is_file = self._kind is Kind.FILE
        if is_file and not Path(self._spec).is_file():
            raise InputError(
                f"camera {self._spec}: no such file; give a device (0 or /dev/video0), a video file or an rtsp:// URL"
            )
        capture = self._open()
        if not capture.is_open:
            capture.release()
            cure = {
                True: "the file is no video that can be decoded; check it with `ffprobe`, or record it again",
                False: "is it connected and free? `v4l2-ctl --list-devices` lists cameras; a URL needs its host",
            }[is_file]
            raise InputError(f"camera {self._spec}: cannot be opened; {cure}")
        picture = capture.retrieve() if capture.grab() else None
        if picture is None:
            capture.release()
            raise InputError(f"camera {self._spec}: opened but gave no picture; the file or stream holds no video")
        return capture, picture

    def _read_all(self) -> None:
        try:
            if self._kind is Kind.FILE:
                self._play()
            else:
                self._capture_live()
        finally:
            self._capture.release()

    def _play(self) -> None:
        """A file by its own stamps. A picture counts as captured when it is due; its conversion is part of the latency."""
        stamps_ns = None if self._wanted_fps is not None else _neon_stamps_ns(Path(self._spec))
        started_ns = self._clock_ns()
        while True:
            played, first_ms, last_ns, spacing_ns = 0, 0.0, -1, round(1e9 / self.fps)
            while self._first is not None or self._capture.grab():
                stamp_ms = self._capture.stamp_ms
                first_ms = stamp_ms if not played else first_ms
                given_ns = stamps_ns[played] if stamps_ns and played < len(stamps_ns) else None
                before_ns, last_ns = last_ns, self._offset_ns(played, stamp_ms - first_ms, given_ns, last_ns)
                spacing_ns = last_ns - before_ns if played else spacing_ns
                played += 1
                if not self._sleep_until(started_ns + last_ns):
                    return
                self._show(started_ns + last_ns)
            if not self._loop or not played:
                return
            self._capture.release()
            self._capture = self._open()
            started_ns = begins_again_ns(started_ns, last_ns, spacing_ns, self._clock_ns())

    def _offset_ns(self, played: int, stamp_ms: float, given_ns: int | None, last_ns: int) -> int:
        """When the picture is due, from the first: as given, else by the file's stamp, else (no stamps) by the rate."""
        if given_ns is not None:
            return max(given_ns, last_ns + 1)
        stamp_ns = round(stamp_ms * 1e6) if math.isfinite(stamp_ms) else -1
        return stamp_ns if self._wanted_fps is None and stamp_ns > last_ns else round(played * 1e9 / self.fps)

    def _show(self, due_ns: int) -> None:
        """Hand on the picture that was grabbed, or count it as failed."""
        first, self._first = self._first, None
        picture = first if first is not None else self._capture.retrieve()
        if picture is not None:
            self._deliver_picture(picture, due_ns)
        else:
            self.cell.fail()

    def _capture_live(self) -> None:
        failures = 0
        while not self._stopping.is_set():
            picture = self._next_picture()
            if picture is not None:
                failures = self._reopened = 0
                self._deliver_picture(picture, self._grabbed_ns)
                continue
            failures += 1
            self.cell.fail()
            # A stream's read has waited its time-out; a device may miss a picture now and then.
            if failures >= (_READS_BEFORE_GONE if self._kind is Kind.DEVICE else 1) and not self._reopen():
                return

    def _deliver_picture(self, rgb: NDArray[np.uint8], captured_ns: int) -> None:
        self._sequence += 1
        self._deliver(CameraFrame(captured_ns, rgb, self._sequence, self._stamp), captured_ns)

    def _next_picture(self) -> NDArray[np.uint8] | None:
        """The next picture, or None where there is none to be had."""
        if self._first is not None:
            first, self._first = self._first, None
            return first
        if not self._capture.grab():
            return None
        now_ns, last_ns = self._clock_ns(), self._grabbed_ns
        if self._kind is Kind.DEVICE:
            stamped = taken_at(self._capture.stamp_ms, now_ns, self._latency_ns, last_ns)
        else:
            stamped = self._sender.taken_at(self._capture.sender_ns, now_ns, self._latency_ns, last_ns)
        self._grabbed_ns, self._stamp = stamped
        return self._capture.retrieve()

    def _reopen(self) -> bool:
        """Try to get the device back until it works (True) or the source is to stop (False)."""
        self.state, self.detail = SourceState.GONE, "no pictures; trying to reopen"
        while not self._stopping.wait(_RETRIES_S[min(self._reopened, len(_RETRIES_S) - 1)]):
            self._reopened += 1
            self._capture.release()
            self._capture = self._open(_REOPEN_TIMEOUT_MS)
            if self._capture.is_open:
                self._sender.forget()
                return True
        return False


def _kind(spec: str) -> Kind:
    if spec.isdigit() or _is_character_device(spec):
        return Kind.DEVICE
    return Kind.STREAM if "://" in spec else Kind.FILE


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
