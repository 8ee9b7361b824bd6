"""A Pupil Labs Neon recording folder as the Companion app writes it: `gaze ps*.raw` and `.time`, `info.json`.

Gaze is float32 pairs in pixels of the 1600 x 1200 scene camera, stamps are int64 nanoseconds of the wall clock, blinks
are int32 type, int64 start, int64 end (the `.dtype` files beside them say so). A recording that the app split has parts
ps1, ps2, ...
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import InputError

SCENE_WIDTH_PX, SCENE_HEIGHT_PX = 1600, 1200
_BLINK = np.dtype([("type", "<i4"), ("start_ns", "<i8"), ("end_ns", "<i8")])


def read_gaze(
    folder: Path,
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Stamps (wall clock, ns), x and y in 0..1, validity: (N,) each. A sample in a blink or off the head is invalid.

    Raises InputError naming the file and the cure.
    """
    _check_info(folder)
    parts = sorted(folder.glob("gaze ps*.raw"))
    if not parts:
        raise InputError(f"gaze {folder}: no `gaze ps1.raw`; export the recording folder from the Neon Companion again")
    stamps, points, worn = [], [], []
    for raw in parts:
        time_path = raw.with_suffix(".time")
        stamp = _array(time_path, np.dtype("<i8"))
        point = _array(raw, np.dtype("<f4")).reshape(-1, 2) if raw.stat().st_size % 8 == 0 else None
        if point is None or len(point) != len(stamp):
            raise InputError(
                f"gaze {raw}: {raw.stat().st_size} bytes for {len(stamp)} stamps in {time_path.name} (8 each are due); "
                "the recording is truncated, copy it from the phone again"
            )
        stamps.append(stamp)
        points.append(point)
        worn_path = folder / raw.name.replace("gaze", "worn")
        flags = _array(worn_path, np.dtype("u1")) if worn_path.is_file() else np.empty(0)
        worn.append(flags.astype(np.int64) > 0 if len(flags) == len(stamp) else np.ones(len(stamp), bool))
    time_ns = np.concatenate(stamps).astype(np.int64)
    pixels = np.concatenate(points).astype(np.float64)
    valid = np.concatenate(worn) & ~_in_blink(folder, time_ns)
    return time_ns, pixels[:, 0] / SCENE_WIDTH_PX, pixels[:, 1] / SCENE_HEIGHT_PX, valid


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
