"""Gaze as CSV: columns time_s, x, y[, valid] in 0..1 of the picture, or the Neon Cloud's gaze.csv in pixels."""

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
            reader = csv.DictReader(file)
            names = set(reader.fieldnames or ())
            is_cloud = names.issuperset(_CLOUD)
            missing = set(_OWN) - names
            if missing and not is_cloud:
                raise InputError(
                    f"gaze {path}: no column {', '.join(sorted(missing))}; the header needs time_s,x,y[,valid]"
                )
            rows, bad = _rows(path, reader, _cloud_row if is_cloud else _own_row)
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(
            f"gaze {path}: not a CSV text ({error}); save it as UTF-8 with the header time_s,x,y[,valid]"
        ) from None
    if not rows:
        raise InputError(
            f"gaze {path}: no row could be read ({bad} bad); columns are time_s,x,y[,valid] with x, y in 0..1"
        )
    stamps, xs, ys, valids = zip(*rows, strict=True)
    scene_ns = _scene_start_ns(path.with_name("world_timestamps.csv")) if is_cloud else None
    arrays = np.array(stamps, np.int64), np.array(xs), np.array(ys), np.array(valids, bool)
    return CsvGaze(*arrays, bad, "neon cloud" if is_cloud else "csv", scene_ns)


def _rows(path: Path, reader: Iterable[_Cells], read: Callable[[_Cells], _Row]) -> tuple[list[_Row], int]:
    rows, bad = [], 0
    cells: _Cells = {}
    for cells in reader:
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
        return int(first[_STAMP])
    except (KeyError, TypeError, ValueError):
        raise InputError(f"gaze {path}: no {_STAMP!r} in its first row; export the recording again") from None
