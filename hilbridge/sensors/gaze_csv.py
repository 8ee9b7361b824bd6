"""Gaze as CSV: columns time_s, x, y[, valid] in 0..1 of the picture, the Neon Cloud's gaze.csv, Pupil Core's export.

Cells may be separated by semicolons or tabs; then decimals may have commas.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import InputError
from hilbridge.sensors.pupil_labs import SCENE_HEIGHT_PX, SCENE_WIDTH_PX

_OWN = ("time_s", "x", "y")
_STAMP = "timestamp [ns]"
_CLOUD = (_STAMP, "gaze x [px]", "gaze y [px]")
_CORE = ("gaze_timestamp", "norm_pos_x", "norm_pos_y", "confidence")
_CORE_STAMP = "# timestamps [seconds]"  # of its world_timestamps.csv
_CORE_CONFIDENCE = 0.6  # below, Pupil Core's own programs leave a sample out
_Row = tuple[int, float, float, bool]
_Cells = Mapping[str, str | None]


class CsvGaze(NamedTuple):
    """Arrays are (N,). `scene_ns`: when the scene video begins (world_timestamps.csv beside a Cloud file), or None."""

    time_ns: NDArray[np.int64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    valid: NDArray[np.bool_]
    bad: int
    name: str
    scene_ns: int | None


def read_csv(path: Path) -> CsvGaze:
    """Rows that do not parse are counted and left out. Raises InputError naming the file and the cure."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            header = file.readline()
            separator = max(",;\t", key=header.count) if header else ","
            file.seek(0)
            reader = csv.DictReader(file, delimiter=separator)
            name, read = _layout(path, set(reader.fieldnames or ()))
            rows, bad = _rows(path, reader if separator == "," else map(_with_points, reader), read)
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(
            f"gaze {path}: not a CSV text ({error}); save it as UTF-8 with the header time_s,x,y[,valid]"
        ) from None
    if not rows:
        raise InputError(
            f"gaze {path}: no row could be read ({bad} bad); columns are time_s,x,y[,valid] with x, y in 0..1"
        )
    stamps, xs, ys, valids = zip(*rows, strict=True)
    scene_ns = None if name == "csv" else _scene_start_ns(path.with_name("world_timestamps.csv"))
    arrays = np.array(stamps, np.int64), np.array(xs), np.array(ys), np.array(valids, bool)
    return CsvGaze(*arrays, bad, name, scene_ns)


def _layout(path: Path, names: set[str]) -> tuple[str, Callable[[_Cells], _Row]]:
    """What kind of table it is, and how its rows are read. Raises InputError."""
    if names.issuperset(_CLOUD):
        return "neon cloud", _cloud_row
    if names.issuperset(_CORE):
        return "pupil core", _core_row
    missing = set(_OWN) - names
    if missing:
        raise InputError(f"gaze {path}: no column {', '.join(sorted(missing))}; the header needs time_s,x,y[,valid]")
    return "csv", _own_row


def _with_points(cells: _Cells) -> _Cells:
    """Decimals with commas, as programs write them that separate cells otherwise."""
    return {name: text.replace(",", ".") if isinstance(text, str) else text for name, text in cells.items()}


def _rows(path: Path, reader: Iterable[_Cells], read: Callable[[_Cells], _Row]) -> tuple[list[_Row], int]:
    rows, bad = [], 0
    cells: _Cells = {}
    for cells in reader:
        if None in cells:  # what the header has no name for: nobody can say which cell is which
            raise InputError(
                f"gaze {path}: a row has more cells than the header; are its decimals written with commas? "
                "Save it with points, or with semicolons between the cells"
            )
        try:
            rows.append(read(cells))
        except (TypeError, ValueError, OverflowError):
            bad += 1
    if cells and None in cells.values():
        raise InputError(f"gaze {path}: the last row lacks columns; it is truncated, copy or export it again")
    return rows, bad


def _own_row(cells: _Cells) -> _Row:
    time_s, x, y = (float(cells[name] or "") for name in _OWN)
    return round(time_s * 1e9), x, y, float(cells.get("valid") or 1) != 0.0


def _core_row(cells: _Cells) -> _Row:
    """Pupil Core counts y from below."""
    time_s, x, y, confidence = (float(cells[name] or "") for name in _CORE)
    return round(time_s * 1e9), x, 1.0 - y, confidence >= _CORE_CONFIDENCE


def _cloud_row(cells: _Cells) -> _Row:
    stamp, x, y = (cells[name] or "" for name in _CLOUD)
    # A file with a `worn` column of which the cell is empty does not say that the glasses were on the head.
    worn = "worn" not in cells or (cells["worn"] or "").strip().lower() in ("1", "1.0", "255", "true")
    in_blink = bool((cells.get("blink id") or "").strip())
    return int(stamp), float(x) / SCENE_WIDTH_PX, float(y) / SCENE_HEIGHT_PX, worn and not in_blink


def _scene_start_ns(path: Path) -> int | None:
    if not path.is_file():
        return None
    with path.open(newline="", encoding="utf-8-sig") as file:
        first = next(csv.DictReader(file), {})
    try:
        return round(float(first[_CORE_STAMP]) * 1e9) if _CORE_STAMP in first else int(first[_STAMP])
    except (KeyError, TypeError, ValueError):
        raise InputError(f"gaze {path}: no {_STAMP!r} in its first row; export the recording again") from None
