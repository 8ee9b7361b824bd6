"""Gaze recordings played as if they were a live eye tracker: Pupil Labs Neon folders, BeGaze exports, CSV."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.records import GazeSample, StampSource
from hilbridge.sensors import pupil_labs
from hilbridge.sensors.begaze import read_begaze
from hilbridge.sensors.gaze_csv import read_csv
from hilbridge.sensors.recorded.iassistadl import is_iassistadl, read_iassistadl
from hilbridge.sensors.source import Source, begins_again_ns

_CORE_FILE = "gaze_positions.csv"  # of Pupil Player's export
_SLOWEST_NS = 1_500 * MS  # between samples of any eye tracker there is; more are stamps in another unit


@dataclass(frozen=True, slots=True)
class GazeRecording:
    """A recording in memory. Arrays are (N,): time since the scene video's start, x, y in 0..1 of the picture, validity.

    Where the file does not tell the video's time, it is the time since the first sample. `time_ns` increases strictly;
    what is below zero was seen before the video began and is not played. `bad_rows` counts what could not be read and was
    left out, `notes` say what else a person wants to know of it.
    """

    time_ns: NDArray[np.int64]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    valid: NDArray[np.bool_]
    bad_rows: int
    format: str
    notes: tuple[str, ...] = ()


def open_gaze(path: Path) -> GazeRecording:
    """Read a folder (Neon, Pupil Core export, iAssistADL), a BeGaze text export, or a CSV (see gaze_csv.py).

    Raises InputError naming the file and the cure.
    """
    if path.is_dir() and (path / _CORE_FILE).is_file():
        return csv_recording(path / _CORE_FILE)
    if path.is_dir():
        return iassistadl_recording(path) if is_iassistadl(path) else pupil_labs_recording(path)
    if not path.is_file():
        raise InputError(f"gaze {path}: no such file or folder; give a Neon recording folder, a BeGaze .txt or a .csv")
    if path.stat().st_size == 0:
        raise InputError(f"gaze {path}: the file is empty; export the recording again")
    if path.suffix.lower() == ".csv":
        return csv_recording(path)
    return begaze_recording(path)


def pupil_labs_recording(folder: Path) -> GazeRecording:
    """Read a Neon recording's gaze (see pupil_labs.py), or what the Cloud makes of it (gaze.csv)."""
    if (folder / "gaze.csv").is_file() and not any(folder.glob("gaze ps*.raw")):
        return csv_recording(folder / "gaze.csv")
    found = pupil_labs.read_gaze(folder)
    return _checked(folder, found.time_ns, (found.x, found.y, found.valid), 0, "neon", origin_ns=found.scene_ns)


def iassistadl_recording(folder: Path) -> GazeRecording:
    """Read the gaze of a recording of the iAssistADL group (see recorded/iassistadl.py)."""
    found = read_iassistadl(folder)
    x, y = found.gaze.values.T
    said = _checked(
        folder, found.gaze.time_ns, (x, y, np.ones(len(x), bool)), found.bad_rows, "iassistadl", origin_ns=None
    )
    streams = (found.gaze, *found.inertial, *found.wrists)
    return replace(said, notes=tuple(map(str, streams)))


def begaze_recording(path: Path) -> GazeRecording:
    """Read a BeGaze export. BeGaze ends every line, so one that is not ended was cut off."""
    with path.open("rb") as file:
        file.seek(-1, 2)
        if file.read(1) not in b"\r\n":
            raise InputError(f"gaze {path}: ends in the middle of a line; it is truncated, copy or export it again")
    table = read_begaze(path)
    return _checked(
        path, table.played_ns(), (table.x, table.y, table.valid), table.bad_lines, "begaze", origin_ns=table.origin_ns()
    )


def csv_recording(path: Path) -> GazeRecording:
    """Read a .csv: our own columns, or the Neon Cloud's."""
    found = read_csv(path)
    return _checked(
        path, found.time_ns, (found.x, found.y, found.valid), found.bad, found.name, origin_ns=found.scene_ns
    )


def _checked(
    path: Path,
    time_ns: NDArray[np.int64],
    columns: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]],
    bad: int,
    name: str,
    *,
    origin_ns: int | None = None,
) -> GazeRecording:
    """Refuse what cannot be played; leave out rows that go back in time; mark what is no number as invalid.

    `origin_ns` is the stamp at which the scene video begins; None: not known, the first sample counts as it.
    """
    x, y, valid = columns
    if len(time_ns) < 2:
        raise InputError(f"gaze {path}: {len(time_ns)} sample(s); a recording needs at least two, export it again")
    forward = np.concatenate(([True], time_ns[1:] > np.maximum.accumulate(time_ns)[:-1]))
    bad += int((~forward).sum())
    time_ns, x, y, valid = time_ns[forward], x[forward].copy(), y[forward].copy(), valid[forward]
    if len(time_ns) > 2 and float(np.median(np.diff(time_ns))) > _SLOWEST_NS:
        raise InputError(
            f"gaze {path}: {np.median(np.diff(time_ns)) / 1e9:.3g} s from sample to sample; are the stamps in another "
            "unit (milliseconds, nanoseconds)? time_s is in seconds"
        )
    usable = valid & np.isfinite(x) & np.isfinite(y)
    inside = (x >= 0.0) & (x <= 1.0) & (y >= 0.0) & (y <= 1.0)
    if len(time_ns) < 2 or not (usable & inside).any():
        raise InputError(f"gaze {path}: no valid sample inside the picture; x, y must be 0..1 of the scene camera")
    x[~usable], y[~usable] = 0.0, 0.0
    start_ns = int(time_ns[0]) if origin_ns is None else origin_ns
    if time_ns[-1] < start_ns:
        raise InputError(f"gaze {path}: ends before the scene video begins; the two are of different recordings")
    first_ms = (int(time_ns[0]) - start_ns) / MS
    notes = () if origin_ns is None else (f"on the scene video's clock, from {first_ms:+.0f} ms of its start",)
    return GazeRecording(time_ns - start_ns, x, y, usable & inside, bad, name, notes)


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
        started_ns = self._clock_ns()
        while True:
            due_ns = before_ns = started_ns
            for offset_ns, x, y, valid in zip(
                recording.time_ns.tolist(),
                recording.x.tolist(),
                recording.y.tolist(),
                recording.valid.tolist(),
                strict=True,
            ):
                if offset_ns < 0:
                    continue
                before_ns, due_ns = due_ns, started_ns + offset_ns
                if not self._sleep_until(due_ns):
                    return
                assert math.isfinite(x)
                self._deliver(GazeSample(due_ns, x, y, valid, StampSource.HARDWARE), due_ns)
            if not self._loop:
                return
            started_ns = begins_again_ns(started_ns, due_ns - started_ns, due_ns - before_ns, self._clock_ns())
