"""A Pupil Labs Neon recording folder as the Companion app writes it: `gaze ps*.raw` and `.time`, `info.json`.

Gaze is float32 pairs in pixels of the 1600 x 1200 scene camera, stamps are int64 nanoseconds of the wall clock, blinks
are int32 type, int64 start, int64 end (the `.dtype` files beside them say so). A recording that the app split has parts
ps1, ps2, ...
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import InputError

SCENE_WIDTH_PX, SCENE_HEIGHT_PX = 1600, 1200
_BLINK = np.dtype([("type", "<i4"), ("start_ns", "<i8"), ("end_ns", "<i8")])


class NeonGaze(NamedTuple):
    """Stamps (wall clock, ns), x and y in 0..1, validity: (N,) each. `scene_ns`: when the scene video begins, or None."""

    time_ns: NDArray[np.int64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    valid: NDArray[np.bool_]
    scene_ns: int | None


def read_gaze(folder: Path) -> NeonGaze:
    """A recording's gaze, the 200 Hz file (computed later) where it has more. A sample in a blink, off the head, or of
    which no flag says that the glasses were worn is invalid; a recording without any flags is of an older app.

    Raises InputError naming the file and the cure.
    """
    _check_info(folder)
    parts = sorted(folder.glob("gaze ps*.raw"), key=_part_number)
    later = folder / "gaze_200hz.raw"
    if not parts and not later.is_file():
        raise InputError(f"gaze {folder}: no `gaze ps1.raw`; export the recording folder from the Neon Companion again")
    has_flags = any(folder.glob("worn*.raw"))
    read = [_part(raw, raw.with_name(raw.name.replace("gaze", "worn")), has_flags=has_flags) for raw in parts]
    time_ns, pixels, worn = (np.concatenate(column) for column in zip(*read, strict=True)) if read else _NOTHING
    if later.is_file():
        flags = folder / "worn_200hz.raw"
        more_ns, more_pixels, more_worn = _part(later, flags, has_flags=has_flags and (flags.is_file() or not read))
        if len(more_ns) > len(time_ns):
            if has_flags and not flags.is_file() and len(time_ns):
                more_worn = worn[np.clip(np.searchsorted(time_ns, more_ns, side="right") - 1, 0, None)]
            time_ns, pixels, worn = more_ns, more_pixels, more_worn
    valid = worn & ~_in_blink(folder, time_ns)
    scenes = sorted(folder.glob("Neon Scene Camera* ps*.time"), key=_part_number)
    scene = _array(scenes[0], np.dtype("<i8")) if scenes else np.empty(0)
    x, y = pixels[:, 0] / SCENE_WIDTH_PX, pixels[:, 1] / SCENE_HEIGHT_PX
    return NeonGaze(time_ns, x, y, valid, int(scene[0]) if len(scene) else None)


_NOTHING = (np.empty(0, np.int64), np.empty((0, 2)), np.empty(0, bool))


def _part_number(path: Path) -> int:
    """`gaze ps10.raw` comes after `gaze ps2.raw`."""
    found = re.search(r"ps(\d+)\.", path.name)
    return int(found[1]) if found else 0


def _part(
    raw: Path, worn_path: Path, *, has_flags: bool
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_]]:
    """One part's stamps, pixels (N, 2) and whether the glasses were surely on the head."""
    time_path = raw.with_suffix(".time")
    stamp = _array(time_path, np.dtype("<i8"))
    point = _array(raw, np.dtype("<f4")).reshape(-1, 2) if raw.stat().st_size % 8 == 0 else None
    if point is None or len(point) != len(stamp):
        raise InputError(
            f"gaze {raw}: {raw.stat().st_size} bytes for {len(stamp)} stamps in {time_path.name} (8 each are due); "
            "the recording is truncated, copy it from the phone again"
        )
    worn = np.full(len(stamp), not has_flags)
    if worn_path.is_file():
        flags = _array(worn_path, np.dtype("u1"))[: len(stamp)]
        worn[: len(flags)] = flags.astype(np.int64) > 0
    return stamp.astype(np.int64), point.astype(np.float64), worn


def _check_info(folder: Path) -> None:
    path = folder / "info.json"
    try:
        info = json.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise InputError(
            f"gaze {folder}: no info.json, so no Neon recording folder; name the folder that holds it"
        ) from None
    except (OSError, ValueError) as error:
        raise InputError(
            f"gaze {path}: not readable as JSON ({error}); copy the recording from the phone again"
        ) from None
    if not isinstance(info, dict) or "gaze_frequency" not in info:
        raise InputError(
            f"gaze {path}: names no gaze_frequency, so no Neon recording; export it from the Companion again"
        )


def _in_blink(folder: Path, time_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    blinking = np.zeros(len(time_ns), bool)
    for path in sorted(folder.glob("blinks ps*.raw")):
        for blink in _array(path, _BLINK):
            blinking |= (time_ns >= blink["start_ns"]) & (time_ns <= blink["end_ns"])
    return blinking


def _array(path: Path, dtype: np.dtype[np.generic]) -> NDArray[np.generic]:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"gaze {path}: {error.strerror}; copy the recording from the phone again") from None
    if len(data) % dtype.itemsize:
        raise InputError(
            f"gaze {path}: {len(data)} bytes are no whole number of {dtype.itemsize}-byte records; copy it again"
        )
    return np.frombuffer(data, dtype)
