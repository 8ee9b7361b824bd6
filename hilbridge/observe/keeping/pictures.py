"""Pictures for a recording: made smaller and JPEG in a thread of their own, away from tick and vision.

Whoever offers a picture never waits. Where the thread is not done with the ones before, it is dropped, and counted.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hilbridge.features.scene import shrink
from hilbridge.priority import Level, take_level
from hilbridge.records import CameraFrame
from hilbridge.rows import ImageRow, Look, SceneRow, image_stamp
from hilbridge.sensors.faces import FaceBlur

_WAITING = 4
FRAME_ID = "head_camera"


@dataclass(frozen=True, slots=True)
class PictureFormat:
    """quality: of JPEG, 1..100. width_px: pictures that are wider are made so wide.

    blur_faces: faces are blurred, and the pixels of scene features, where a face may be seen as well, are left out.
    """

    quality: int = 80
    width_px: int = 640
    blur_faces: bool = False


class Scratch:
    """Memory that one picture after the other is made smaller in. New memory for each costs more than the work itself."""

    def __init__(self) -> None:
        self._small = self._bgr = np.empty((0, 0, 3), np.uint8)

    def bgr(self, rgb: NDArray[np.uint8], size_px: tuple[int, int]) -> Any:
        """The picture as JPEG's encoder takes it, (width, height) of size_px; good until the next call."""
        shape = size_px[1], size_px[0], 3
        if self._bgr.shape != shape:
            self._small, self._bgr = np.empty(shape, np.uint8), np.empty(shape, np.uint8)
        small: Any = rgb
        if rgb.shape != shape:
            small = cv2.resize(rgb, size_px, dst=self._small, interpolation=cv2.INTER_LINEAR)
        return cv2.cvtColor(small, cv2.COLOR_RGB2BGR, dst=self._bgr)


def image_row(frame: CameraFrame, form: PictureFormat, now_ns: int, scratch: Scratch | None = None) -> ImageRow:
    """The picture as it is stored. Raises ValueError where it cannot be."""
    height_px, width_px = frame.rgb.shape[:2]
    size_px = width_px, height_px
    if width_px > form.width_px:
        size_px = form.width_px, max(1, round(height_px * form.width_px / width_px))
    bgr = (Scratch() if scratch is None else scratch).bgr(frame.rgb, size_px)
    done, data = cv2.imencode(".jpg", bgr, (cv2.IMWRITE_JPEG_QUALITY, form.quality))
    if not done:
        raise ValueError(f"a picture of {width_px} x {height_px} that JPEG cannot hold")
    return ImageRow(
        now_ns,
        frame.captured_ns,
        image_stamp(frame.captured_ns),
        FRAME_ID,
        data.tobytes(),
        "jpeg",
        frame.sequence,
        width_px,
        height_px,
        frame.stamp,
    )


def scene_row(frame: CameraFrame, now_ns: int) -> SceneRow:
    """What scene features look at. Raises ValueError for what is no picture."""
    small = shrink(frame.rgb)
    height_px, width_px = small.shape[:2]
    if not small.size:
        raise ValueError("a picture without a pixel")
    return SceneRow(now_ns, frame.captured_ns, frame.sequence, width_px, height_px, small.tobytes())


def scene_frame(row: SceneRow) -> CameraFrame:
    """A picture whose scene features are those of the picture that the row was made of. Raises ValueError."""
    pixels = np.frombuffer(row.rgb, np.uint8)
    if pixels.size != row.height_px * row.width_px * 3:
        raise ValueError(f"scene {row.sequence}: {pixels.size} bytes for {row.width_px} x {row.height_px} pixels")
    return CameraFrame(row.captured_ns, pixels.reshape(row.height_px, row.width_px, 3), row.sequence)


def camera_frame(row: ImageRow) -> CameraFrame:
    """The picture of a row. Raises ValueError where it cannot be read."""
    bgr = cv2.imdecode(np.frombuffer(row.data, np.uint8), cv2.IMREAD_COLOR)
    if bgr is None:
        raise ValueError(f"picture {row.sequence} cannot be read")
    rgb = np.ascontiguousarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)).astype(np.uint8, copy=False)
    return CameraFrame(row.captured_ns, rgb, row.sequence, row.stamp)


def _nowhere(row: ImageRow | SceneRow) -> None:
    """Pictures that are shared and not kept."""


class Pictures:
    """Takes pictures from one thread, gives rows to a recording. `close()` it before the recording.

    `share` may be set: it is given each row with what was seen in the picture, in the thread that makes the JPEG.
    """

    def __init__(self, form: PictureFormat, record: Callable[[ImageRow | SceneRow], None] | None) -> None:
        """`record` None keeps none of them. Raises InputError where faces are to be blurred and nothing can find them."""
        self._form, self._record, self.kept = form, record or _nowhere, record is not None
        self._blur = FaceBlur() if form.blur_faces else None
        self._frames: queue.Queue[tuple[CameraFrame, int, Look | None] | None] = queue.Queue(_WAITING)
        self.share: Callable[[ImageRow, Look], None] | None = None
        self.stored = self.dropped = self.failed = 0
        self.cpu_s = 0.0
        self._scratch = Scratch()
        self._thread = threading.Thread(target=self._run, name="pictures", daemon=True)
        self._thread.start()

    def offer(self, frame: CameraFrame, now_ns: int, look: Look | None = None) -> None:
        """Store it, as of now, if there is time; `look` has what was seen in it."""
        try:
            self._frames.put_nowait((frame, now_ns, look))
        except queue.Full:
            self.dropped += 1

    def close(self) -> None:
        """Store what waits, then end."""
        self._frames.put(None)
        self._thread.join()

    def _run(self) -> None:
        while (offered := self._frames.get()) is not None:
            take_level(Level.RECORDING)  # each time: a run asks for real time after its recording has begun
            try:
                frame, now_ns, look = offered
                if self._blur is None:
                    if self.kept:
                        self._record(scene_row(frame, now_ns))
                else:
                    frame = CameraFrame(frame.captured_ns, self._blur.apply(frame.rgb), frame.sequence, frame.stamp)
                row = image_row(frame, self._form, now_ns, self._scratch)
                self._record(row)
                self.stored += 1
                if look is not None and (share := self.share) is not None:
                    share(row, look)
            except Exception:  # whatever a codec or a detector raises: a thread that ended would never let the run end
                self.failed += 1
            self.cpu_s = time.thread_time()
