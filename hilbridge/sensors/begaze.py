"""BeGaze text exports, versions 3.1 and 3.4, as EGTEA Gaze+ ships them: text in, gaze per video frame out. Pure.

Header lines begin with `##`; columns are found by their names. Version 3.1 has the left eye's point of regard and a
frame number, 3.4 the binocular one and a frame as HH:MM:SS:FF at 24 frames per second. Samples come at 30 Hz, but the
video's own time is frame / 24: the sample clock and the video drift apart.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import InputError

FRAMES_PER_S = 24.0
MAX_BYTES = 512 << 20


class BegazeError(InputError):
    """The file is no usable BeGaze export; the message names it and the cure."""


@dataclass(frozen=True, slots=True)
class BegazeRecording:
    """One export. All arrays have one entry per sample, in file order.

    time_us: the tracker's clock; frame: the scene video's frame number; x, y: point of regard in 0..1 of the calibration
    area (0 where invalid); valid: False in blinks and where the tracker lost the eyes. bad_lines counts data lines that
    could not be read and were left out; messages counts lines that are no samples.
    """

    version: str
    area_px: tuple[int, int]
    rate_hz: float
    time_us: NDArray[np.int64]
    frame: NDArray[np.int64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    valid: NDArray[np.bool_]
    bad_lines: int
    messages: int

    def video_s(self) -> NDArray[np.float64]:
        """Seconds of the scene video each sample belongs to (frame / 24)."""
        return self.frame / FRAMES_PER_S


@dataclass(frozen=True, slots=True)
class _Columns:
    time: int
    kind: int
    x: int
    y: int
    frame: int
    event: int
    least: int


def read_begaze(path: Path) -> BegazeRecording:
    """Read one export. Raises BegazeError naming the file, what is wrong and the cure."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise BegazeError(f"{path}: larger than {MAX_BYTES >> 20} MB; give a BeGaze text export of one session")
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise BegazeError(f"{path}: cannot be read ({error.strerror or error}); check the path") from None
    try:
        return parse_begaze(text.splitlines())
    except BegazeError as error:
        raise BegazeError(f"{path}: {error}; export the session again from BeGaze as text") from None


def parse_begaze(lines: Iterable[str]) -> BegazeRecording:
    """Parse the lines of one export. Raises BegazeError saying what is missing."""
    header: dict[str, list[str]] = {}
    columns: _Columns | None = None
    rows: list[tuple[int, int, float, float, bool]] = []
    area = (0, 0)
    bad = messages = 0
    for line in lines:
        cells = line.rstrip("\r\n").split("\t")
        if line.startswith("##"):
            header[cells[0].lstrip("# ").rstrip(": ").lower()] = cells[1:]
        elif columns is None:
            if line.strip():
                area = _area(header)
                columns = _find_columns(cells)
        elif not line.strip():
            continue
        elif len(cells) > columns.kind and cells[columns.kind] != "SMP":
            messages += 1
        else:
            row = _row(cells, columns, area)
            if row is None:
                bad += 1
            else:
                rows.append(row)
    if columns is None:
        raise BegazeError("no table of samples in it")
    if not rows:
        raise BegazeError("no sample that could be read in it")
    version = " ".join(header.get("version", ["unknown"])).replace("BeGaze", "").strip()
    rate = _number((header.get("sample rate") or ["30"])[0])
    time_us, frame, x, y, valid = zip(*rows, strict=True)
    return BegazeRecording(
        version,
        area,
        rate if math.isfinite(rate) and rate > 0 else 30.0,
        np.array(time_us, dtype=np.int64),
        np.array(frame, dtype=np.int64),
        np.array(x, dtype=np.float64),
        np.array(y, dtype=np.float64),
        np.array(valid, dtype=bool),
        bad,
        messages,
    )


def _area(header: dict[str, list[str]]) -> tuple[int, int]:
    cells = header.get("calibration area", [])
    try:
        width, height = int(float(cells[0])), int(float(cells[1]))
    except (IndexError, ValueError, OverflowError):
        raise BegazeError("the header names no calibration area") from None
    if not (0 < width <= 20_000 and 0 < height <= 20_000):
        raise BegazeError(f"calibration area of {width} x {height} pixels")
    return width, height


def _find_columns(names: Sequence[str]) -> _Columns:
    index = {name.strip().lower(): position for position, name in enumerate(names)}

    def find(*wanted: str) -> int:
        for name in wanted:
            if name in index:
                return index[name]
        raise BegazeError(f"no column {wanted[0]!r}")

    time, kind = find("time"), find("type")
    x, y = find("b por x [px]", "l por x [px]"), find("b por y [px]", "l por y [px]")
    frame, event = find("frame"), find("b event info", "l event info")
    return _Columns(time, kind, x, y, frame, event, 1 + max(time, kind, x, y, frame))


def _row(cells: Sequence[str], columns: _Columns, area: tuple[int, int]) -> tuple[int, int, float, float, bool] | None:
    """One sample, or None when time or frame cannot be read. A missing point of regard is an invalid sample, not a bad line."""
    if len(cells) < columns.least:
        return None
    frame = _frame(cells[columns.frame])
    time_us = _number(cells[columns.time])
    if frame is None or not math.isfinite(time_us) or abs(time_us) > 1e15:
        return None
    x, y = _number(cells[columns.x]), _number(cells[columns.y])
    event = cells[columns.event].strip().lower() if len(cells) > columns.event else ""
    # The tracker writes 0, 0 where it has no eye.
    valid = math.isfinite(x) and math.isfinite(y) and (x, y) != (0.0, 0.0) and event != "blink"
    if not valid:
        return int(time_us), frame, 0.0, 0.0, False
    return int(time_us), frame, x / area[0], y / area[1], True


def _frame(text: str) -> int | None:
    """A frame number: `123`, or `HH:MM:SS:FF`."""
    parts = text.strip().split(":")
    if not all(part.isascii() and part.isdigit() and len(part) <= 9 for part in parts):
        return None
    numbers = [int(part) for part in parts]
    if len(numbers) == 1:
        return numbers[0]
    if len(numbers) != 4 or numbers[3] >= FRAMES_PER_S:
        return None
    hours, minutes, seconds, frames = numbers
    return ((hours * 60 + minutes) * 60 + seconds) * int(FRAMES_PER_S) + frames


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
