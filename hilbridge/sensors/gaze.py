"""Gaze recordings played as if they were a live eye tracker: Pupil Labs Neon folders, BeGaze exports, CSV."""

from __future__ import annotations

import csv
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import InputError
from hilbridge.records import GazeSample, StampSource
from hilbridge.sensors import pupil_labs
from hilbridge.sensors.begaze import read_begaze
from hilbridge.sensors.source import Source


@dataclass(frozen=True, slots=True)
class GazeRecording:
    """A recording in memory. Arrays are (N,): time since the start, x, y in 0..1 of the picture, validity.

    `time_ns` increases strictly. `bad_rows` counts what could not be read and was left out.
    """

    time_ns: NDArray[np.int64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    valid: NDArray[np.bool_]
    bad_rows: int
    format: str


def open_gaze(path: Path) -> GazeRecording:
    """Read a Neon recording folder, a BeGaze text export, or a CSV with columns time_s, x, y[, valid].

    Raises InputError naming the file and the cure.
    """
    if path.is_dir():
        return pupil_labs_recording(path)
    if not path.is_file():
        raise InputError(f"gaze {path}: no such file or folder; give a Neon recording folder, a BeGaze .txt or a .csv")
    if path.stat().st_size == 0:
        raise InputError(f"gaze {path}: the file is empty; export the recording again")
    if path.suffix.lower() == ".csv":
        return read_csv(path)
    return begaze_recording(path)


def pupil_labs_recording(folder: Path) -> GazeRecording:
    """Read a Neon recording's gaze (see pupil_labs.py)."""
    time_ns, x, y, valid = pupil_labs.read_gaze(folder)
    return _checked(folder, time_ns, x, y, valid, 0, "neon")


def begaze_recording(path: Path) -> GazeRecording:
    """Read a BeGaze 3.1 or 3.4 export. BeGaze ends every line, so one that is not ended was cut off."""
    with path.open("rb") as file:
        file.seek(-1, 2)
        if file.read(1) not in b"\r\n":
            raise InputError(f"gaze {path}: ends in the middle of a line; it is truncated, copy or export it again")
    table = read_begaze(path)
    return _checked(path, table.time_us * 1000, table.x, table.y, table.valid, table.bad_lines, "begaze")


def read_csv(path: Path) -> GazeRecording:
    """Read columns time_s, x, y (0..1) and optionally valid (0/1); rows that do not parse are counted and left out."""
    rows: list[tuple[int, float, float, bool]] = []
    bad = 0
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            missing = {"time_s", "x", "y"} - set(reader.fieldnames or ())
            if missing:
                raise InputError(
                    f"gaze {path}: no column {', '.join(sorted(missing))}; the header needs time_s,x,y[,valid]"
                )
            row: dict[str, str | None] = {}
            for row in reader:
                try:
                    time_s, x, y = float(row["time_s"] or ""), float(row["x"] or ""), float(row["y"] or "")
                    valid = float(row.get("valid") or 1) != 0.0
                    time_ns = round(time_s * 1e9)
                except (TypeError, ValueError, OverflowError):
                    bad += 1
                    continue
                rows.append((time_ns, x, y, valid))
            if row and None in row.values():
                raise InputError(f"gaze {path}: the last row lacks columns; it is truncated, copy or export it again")
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(
            f"gaze {path}: not a CSV text ({error}); save it as UTF-8 with the header time_s,x,y[,valid]"
        ) from None
    if not rows:
        raise InputError(
            f"gaze {path}: no row could be read ({bad} bad); columns are time_s,x,y[,valid] with x, y in 0..1"
        )
    stamps, xs, ys, valids = zip(*rows, strict=True)
    return _checked(path, np.array(stamps, np.int64), np.array(xs), np.array(ys), np.array(valids, bool), bad, "csv")


def _checked(
    path: Path,
    time_ns: NDArray[np.int64],
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    valid: NDArray[np.bool_],
    bad: int,
    name: str,
) -> GazeRecording:
    """Refuse what cannot be played; leave out rows that go back in time; mark what is no number as invalid."""
    if len(time_ns) < 2:
        raise InputError(f"gaze {path}: {len(time_ns)} sample(s); a recording needs at least two, export it again")
    forward = np.concatenate(([True], time_ns[1:] > np.maximum.accumulate(time_ns)[:-1]))
    bad += int((~forward).sum())
    time_ns, x, y, valid = time_ns[forward], x[forward].copy(), y[forward].copy(), valid[forward]
    usable = valid & np.isfinite(x) & np.isfinite(y)
    inside = (x >= 0.0) & (x <= 1.0) & (y >= 0.0) & (y <= 1.0)
    if len(time_ns) < 2 or not (usable & inside).any():
        raise InputError(f"gaze {path}: no valid sample inside the picture; x, y must be 0..1 of the scene camera")
    x[~usable], y[~usable] = 0.0, 0.0
    return GazeRecording(time_ns - time_ns[0], x, y, usable & inside, bad, name)


class GazePlayer(Source[GazeSample]):
    """Plays a recording in real time from the moment it is started; `loop` starts again at its end."""

    def __init__(
        self, recording: GazeRecording, *, loop: bool = False, clock_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        super().__init__("gaze", clock_ns)
        self.recording = recording
        self._loop = loop

    def _read_all(self) -> None:
        recording = self.recording
        while True:
            started_ns = self._clock_ns()
            for offset_ns, x, y, valid in zip(
                recording.time_ns.tolist(),
                recording.x.tolist(),
                recording.y.tolist(),
                recording.valid.tolist(),
                strict=True,
            ):
                due_ns = started_ns + offset_ns
                if not self._sleep_until(due_ns):
                    return
                assert math.isfinite(x)
                self._deliver(GazeSample(due_ns, x, y, valid, StampSource.HARDWARE), due_ns)
            if not self._loop:
                return
