"""The newest picture of the head camera, with gaze and hands, for a monitor of the same user on the same computer.

One small file in the user's runtime folder, in memory where the system has such a folder, which others may not read. It is
replaced whole, at most ten times a second, by the thread that makes the recording's JPEG: nothing of a tick waits for it. It
goes when the run ends; what a killed run leaves is too old to be shown, and goes with the next run on that bus.
"""

from __future__ import annotations

import hashlib
import json
import os
import stat
import sys
import threading
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import platformdirs

from hilbridge.errors import InputError
from hilbridge.files import write_whole
from hilbridge.limits import MS
from hilbridge.rows import GazeRow, HandsRow, ImageRow, Look

SHARED_GAP_NS = 100 * MS  # ten a second
STALE_PICTURE_NS = 1_000 * MS  # older ones are not shown
_MAGIC = b"hilbridge picture 1\n"
_MOST_BYTES = 8 << 20


@dataclass(frozen=True, slots=True)
class SharedPicture:
    """A JPEG, and what was seen in it in 0..1 from the top left. hands: palm x, y, then x, y of each landmark."""

    shared_ns: int
    width_px: int
    height_px: int
    jpeg: bytes
    gaze: tuple[float, float] | None = None
    hands: tuple[tuple[float, ...], ...] = ()

    @property
    def overlay(self) -> dict[str, Any]:
        """What a page draws over it, as JSON has it."""
        return {"width": self.width_px, "height": self.height_px, "gaze": self.gaze, "hands": self.hands}


def shared_path(bus: str) -> Path:
    """Where the picture of the bridge on this bus is; the bus as the port spells it."""
    name = hashlib.sha256(bus.encode()).hexdigest()[:16]
    return Path(platformdirs.user_runtime_dir("hilbridge", appauthor=False)) / f"picture-{name}"


def picture_of(row: ImageRow, look: Look) -> SharedPicture:
    """The picture of a row with what was seen in it."""
    gaze = look.gaze
    hands = () if look.hands is None else look.hands.hands
    return SharedPicture(
        row.time_ns,
        row.width_px,
        row.height_px,
        row.data,
        (round(gaze.x, 4), round(gaze.y, 4)) if gaze is not None and gaze.valid else None,
        tuple(_points(hand.x, hand.y, hand.landmarks) for hand in hands),
    )


def picture_of_rows(image: ImageRow, gaze: GazeRow | None, hands: HandsRow | None) -> SharedPicture:
    """The same of a recording."""
    looked = None
    if gaze is not None and gaze.valid and gaze.x is not None and gaze.y is not None:
        looked = (gaze.x, gaze.y)
    found = () if hands is None else hands.hands
    return SharedPicture(
        image.time_ns,
        image.width_px,
        image.height_px,
        image.data,
        looked,
        tuple(_points(one.x, one.y, one.landmarks) for one in found if one.x is not None and one.y is not None),
    )


def _points(x: float, y: float, landmarks: tuple[float, ...]) -> tuple[float, ...]:
    """Palm, then landmarks without their depth."""
    across, down = landmarks[0::3], landmarks[1::3]
    points = ((x, y), *zip(across, down, strict=False))
    return tuple(round(value, 4) for point in points for value in point)


def packed(picture: SharedPicture) -> bytes:
    """As the file has it."""
    head = {"shared_ns": picture.shared_ns, **picture.overlay}
    return _MAGIC + json.dumps(head).encode() + b"\n" + picture.jpeg


def unpacked(content: bytes) -> SharedPicture | None:
    """None for what is none."""
    if not content.startswith(_MAGIC):
        return None
    line, newline, jpeg = content[len(_MAGIC) :].partition(b"\n")
    if not newline or not jpeg:
        return None
    try:
        head = json.loads(line)
        gaze, hands = head["gaze"], head["hands"]
        return SharedPicture(
            int(head["shared_ns"]),
            int(head["width"]),
            int(head["height"]),
            jpeg,
            None if gaze is None else (float(gaze[0]), float(gaze[1])),
            tuple(tuple(float(value) for value in hand) for hand in hands),
        )
    except (ValueError, KeyError, TypeError, IndexError):
        return None


def newest_picture(path: Path, now_ns: int) -> SharedPicture | None:
    """What is shared now; None where nothing is, or it is old, or somebody else's."""
    try:
        with path.open("rb") as file:
            if not _is_own(os.fstat(file.fileno())):
                return None
            picture = unpacked(file.read(_MOST_BYTES))
    except OSError:
        return None
    if picture is None or not 0 <= now_ns - picture.shared_ns <= STALE_PICTURE_NS:
        return None
    return picture


class Sharing:
    """Shares the pictures of the bridge on one bus while it is open. Raises InputError where there is no safe place."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._shared_ns: int | None = None
        self._open = True
        self._lock = threading.Lock()  # a picture that is being written when it closes must not stay
        self.shared = self.failed = 0
        folder = path.parent
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if not all(stat.S_ISDIR(held.st_mode) and _is_own(held) for held in (folder.lstat(), folder.parent.stat())):
                raise InputError(f"share_pictures: {folder} is somebody else's; remove it, or set XDG_RUNTIME_DIR")
            folder.chmod(0o700)
            path.unlink(missing_ok=True)  # of a run that was killed
        except OSError as error:
            raise InputError(
                f"share_pictures: {folder}: {error.strerror}; set XDG_RUNTIME_DIR to a folder of yours"
            ) from None

    def offer(self, row: ImageRow, look: Look) -> None:
        """Share it, if the last one was a tenth of a second ago. From one thread, which is not the tick's."""
        if self._shared_ns is not None and row.time_ns - self._shared_ns < SHARED_GAP_NS:
            return
        self._shared_ns = row.time_ns
        with self._lock:
            if not self._open:
                return
            try:
                write_whole(self._path, packed(picture_of(row, look)))
                self.shared += 1
            except OSError:  # no room, say: who looks on sees none, the run goes on
                self.failed += 1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._lock:
            self._open = False
            self._path.unlink(missing_ok=True)


def _is_own(held: os.stat_result) -> bool:
    if sys.platform == "win32":  # the folder is in the user's profile
        return True
    return held.st_uid == os.getuid()
