"""BeGaze text exports, versions 3.1 and 3.4, as EGTEA Gaze+ ships them: text in, gaze per video frame out. Pure.

Header lines begin with `##`; columns are found by their names. Version 3.1 has the left eye's point of regard and a
frame number, 3.4 the binocular one and a frame as HH:MM:SS:FF; other exports have the right eye only, no frames, or decimal
commas. The video's own time is frame / frame rate (24 in EGTEA; 25 and 30 occur): the sample clock and the video drift
apart. The frame rate is the header's, else the one that fits frames and sample clock.
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
USUAL_RATES = (24.0, 25.0, 30.0)
_RATE_TOLERANCE = 0.02
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
    frames_per_s: float = FRAMES_PER_S
    has_frames: bool = True

    def video_s(self) -> NDArray[np.float64]:
        """Seconds of the scene video each sample belongs to."""
        return self.frame / self.frames_per_s

    def origin_ns(self) -> int | None:
        """Where the video begins on the clock of `played_ns`; None where the export has no frames."""
        return 0 if self.has_frames else None

    def played_ns(self) -> NDArray[np.int64]:
        """When each sample is due: by the tracker's steps, but always within the frame it belongs to."""
        if not self.has_frames:
            return self.time_us * 1000
        step_ns = np.diff(self.time_us, prepend=self.time_us[:1]) * 1000
        begin_ns = np.round(self.video_s() * 1e9).astype(np.int64)
        last_ns = begin_ns + int(0.99e9 / self.frames_per_s)
        due_ns, made = int(begin_ns[0]), []
        for step, begin, last in zip(step_ns.tolist(), begin_ns.tolist(), last_ns.tolist(), strict=True):
            # A sample that the tracker stamped back in time stays so, and is left out as such.
            due_ns = max(min(max(due_ns + step, begin), last), due_ns + 1) if step > 0 else due_ns + step
            made.append(due_ns)
        return np.array(made, dtype=np.int64)


_Parts = tuple[int, int, int, int]  # hours, minutes, seconds, frames; hours are -1 where frames are just counted
_Sample = tuple[float, _Parts, float, float, bool]


@dataclass(frozen=True, slots=True)
class _Columns:
    time: int
    time_name: str
    kind: int | None
    x: int
    y: int
    frame: int | None
    event: int | None
    least: int


# Names in the order of preference, as BeGaze writes them in its languages and versions.
_TIME = ("time", "recordingtime [ms]", "time [ms]", "zeit", "zeit [ms]", "temps", "tiempo")
_KIND = ("type", "typ", "tipo")
_X = (
    "b por x [px]", "l por x [px]", "r por x [px]",
    "point of regard binocular x [px]", "point of regard left x [px]", "point of regard right x [px]",
)  # fmt: skip
_SAMPLES = ("SMP",)
_FRAME = ("frame", "video frame", "bild", "image")
_EVENT = (
    "b event info", "l event info", "r event info",
    "category binocular", "category left", "category right",
)  # fmt: skip


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
    rows: list[_Sample] = []
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
        elif columns.kind is not None and len(cells) > columns.kind and cells[columns.kind] not in _SAMPLES:
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
    assert columns is not None
    time, parts, x, y, valid = zip(*rows, strict=True)
    rate = rate if math.isfinite(rate) and rate > 0 else 30.0
    time_us = np.round(np.array(time) * _us_per_unit(columns.time_name, np.array(time), rate)).astype(np.int64)
    fps = _frames_per_s(header, parts, time_us)
    frame = [_count(part, fps) for part in parts]
    return BegazeRecording(
        version,
        area,
        rate,
        time_us,
        np.array(frame, dtype=np.int64),
        np.array(x, dtype=np.float64),
        np.array(y, dtype=np.float64),
        np.array(valid, dtype=bool),
        bad,
        messages,
        fps,
        columns.frame is not None,
    )


def _us_per_unit(name: str, time: NDArray[np.float64], rate_hz: float) -> float:
    """Microseconds in one unit of the time column: by its name, else by what fits the sample rate."""
    if "[ms]" in name:
        return 1000.0
    steps = np.diff(time)
    steps = steps[steps > 0]
    if not len(steps):
        return 1.0
    in_us = 1e6 / rate_hz / float(np.median(steps))
    return next((unit for unit in (1000.0, 0.001) if 0.5 < in_us / unit < 2.0), 1.0)


def _frames_per_s(header: dict[str, list[str]], parts: Sequence[_Parts], time_us: NDArray[np.int64]) -> float:
    """The scene video's frame rate: what the header says, else the usual rate that frames and sample clock fit best."""
    for name, cells in header.items():
        if "frame rate" in name or "framerate" in name or "fps" in name:
            said = _number((cells or [""])[0])
            if 1.0 <= said <= 240.0:
                return said
    least = 1 + max((part[3] for part in parts if part[0] >= 0), default=0)
    fitting = [rate for rate in USUAL_RATES if rate >= least] or [float(least)]
    first, last, seconds = parts[0], parts[-1], (int(time_us[-1]) - int(time_us[0])) / 1e6
    if first[0] < 0 and seconds > 0.5:
        seen = (last[3] - first[3]) / seconds
        allowed = max(_RATE_TOLERANCE, 1.5 / (seconds * FRAMES_PER_S))
        near = min(USUAL_RATES, key=lambda rate: abs(seen - rate))
        return near if abs(seen / near - 1.0) <= allowed else FRAMES_PER_S
    return fitting[0]


def _count(part: _Parts, fps: float) -> int:
    hours, minutes, seconds, frames = part
    return frames if hours < 0 else round(((hours * 60 + minutes) * 60 + seconds) * fps) + frames


def _area(header: dict[str, list[str]]) -> tuple[int, int]:
    cells = header.get("calibration area", [])
    try:
        width, height = int(_number(cells[0])), int(_number(cells[1]))
    except (IndexError, ValueError, OverflowError):
        raise BegazeError("the header names no calibration area") from None
    if not (0 < width <= 20_000 and 0 < height <= 20_000):
        raise BegazeError(f"calibration area of {width} x {height} pixels")
    return width, height


def _find_columns(names: Sequence[str]) -> _Columns:
    index = {name.strip().lower(): position for position, name in enumerate(names)}

    def maybe(wanted: Iterable[str]) -> int | None:
        return next((index[name] for name in wanted if name in index), None)

    def find(wanted: Sequence[str]) -> int:
        found = maybe(wanted)
        if found is None:
            raise BegazeError(f"no column {wanted[0]!r}")
        return found

    time, x, y = find(_TIME), find(_X), find([name.replace(" x [", " y [") for name in _X])
    frame, kind = maybe(_FRAME), maybe(_KIND)
    least = 1 + max(place for place in (time, kind, x, y, frame) if place is not None)
    return _Columns(time, names[time].strip().lower(), kind, x, y, frame, maybe(_EVENT), least)


def _row(cells: Sequence[str], columns: _Columns, area: tuple[int, int]) -> _Sample | None:
    """One sample, or None when time or frame cannot be read. A missing point of regard is an invalid sample, not a bad line."""
    if len(cells) < columns.least:
        return None
    frame = (-1, 0, 0, 0) if columns.frame is None else _frame(cells[columns.frame])
    time = _number(cells[columns.time])
    if frame is None or not math.isfinite(time) or abs(time) > 1e15:
        return None
    x, y = _number(cells[columns.x]), _number(cells[columns.y])
    has_event = columns.event is not None and len(cells) > columns.event
    event = cells[columns.event].strip().lower() if has_event and columns.event is not None else ""
    # The tracker writes 0, 0 where it has no eye.
    valid = math.isfinite(x) and math.isfinite(y) and (x, y) != (0.0, 0.0) and event != "blink"
    if not valid:
        return time, frame, 0.0, 0.0, False
    return time, frame, x / area[0], y / area[1], True


def _frame(text: str) -> _Parts | None:
    """A frame number: `123`, or `HH:MM:SS:FF`."""
    parts = text.strip().split(":")
    if not all(part.isascii() and part.isdigit() and len(part) <= 9 for part in parts):
        return None
    numbers = [int(part) for part in parts]
    if len(numbers) == 1:
        return -1, 0, 0, numbers[0]
    if len(numbers) != 4 or numbers[3] >= USUAL_RATES[-1]:
        return None
    hours, minutes, seconds, frames = numbers
    return hours, minutes, seconds, frames


def _number(text: str) -> float:
    try:
        return float(text.strip().replace(",", "."))
    except ValueError:
        return math.nan
