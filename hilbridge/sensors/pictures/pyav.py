"""Pictures through PyAV: files, V4L2 devices, and streams whose RTCP reports say when the sender took each picture."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import needs_extra
from hilbridge.sensors.pictures.capture import Kind

_KEPT_STAMPS = 64  # packets that a decoder may hold back
_UNASKED_S = 10.0


class PyAvCapture:
    """`fps`: asked of a device. Raises InputError where PyAV is not installed."""

    def __init__(self, spec: str, kind: Kind, *, fps: float | None, open_ms: int, read_ms: int) -> None:
        with needs_extra("stream"):
            import av
        av.logging.set_level(None)
        self._errors: tuple[type[BaseException], ...] = (av.FFmpegError, OSError, ValueError)
        self.sender_ns: int | None = None
        self._container: Any = None
        self._frame: Any = None
        self._walls: deque[tuple[int, int]] = deque(maxlen=_KEPT_STAMPS)
        place, form, options = spec, None, {}
        if kind is Kind.DEVICE:
            place, form = f"/dev/video{spec}" if spec.isdigit() else spec, "v4l2"
            options = {} if fps is None else {"framerate": f"{fps:g}"}
        elif spec.startswith("rtsp"):
            options = {"rtsp_transport": "tcp", "fflags": "nobuffer", "flags": "low_delay"}
        limit_s = (open_ms / 1e3, read_ms / 1e3) if kind is Kind.STREAM else (_UNASKED_S, _UNASKED_S)
        try:
            self._container = av.open(place, format=form, options=options, timeout=limit_s)
            self._stream: Any = next(iter(self._container.streams.video), None)
        except self._errors:
            self._stream = None
        if self._stream is None:
            self.release()
            return
        # Its own threads would starve behind the real-time threads that wait for the picture (see OpenCvCapture).
        self._stream.codec_context.thread_count = 1
        self._frames = self._decoded()

    @property
    def is_open(self) -> bool:
        return self._container is not None

    @property
    def fps(self) -> float:
        rate = self._stream.average_rate or self._stream.guessed_rate
        return float(rate) if rate else 0.0

    @property
    def stamp_ms(self) -> float:
        frame = self._frame
        if frame is None or frame.pts is None or frame.time_base is None:
            return math.nan
        return float(frame.pts * frame.time_base * 1000)

    def grab(self) -> bool:
        try:
            self._frame = next(self._frames, None)
        except self._errors:
            self._frame = None
        self.sender_ns = None if self._frame is None else self._wall_of(self._frame.pts)
        return self._frame is not None

    def retrieve(self) -> NDArray[np.uint8] | None:
        try:
            picture = np.asarray(self._frame.to_ndarray(format="rgb24"), np.uint8)
        except self._errors:
            return None
        turns = round(getattr(self._frame, "rotation", 0) / 90)
        return np.ascontiguousarray(np.rot90(picture, turns)) if turns % 4 else picture

    def release(self) -> None:
        if self._container is not None:
            self._container.close()
        self._container = self._frame = None

    def _decoded(self) -> Iterator[Any]:
        """Frames until the end. A packet that does not decode is skipped, as players do."""
        for packet in self._container.demux(self._stream):
            if packet.has_sidedata("prft"):
                # A ProducerReferenceTime of FFmpeg: wall clock in us, first of all, in the machine's own byte order.
                data = bytes(packet.get_sidedata("prft"))
                if packet.pts is not None and len(data) >= 8:
                    self._walls.append((packet.pts, int(np.frombuffer(data[:8], np.int64)[0]) * 1000))
            try:
                yield from packet.decode()
            except self._errors:
                continue

    def _wall_of(self, pts: int | None) -> int | None:
        return next((wall_ns for at, wall_ns in reversed(self._walls) if at == pts), None)
