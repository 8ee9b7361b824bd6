"""A recording folder of the iAssistADL group: gaze.csv of a Pupil Invisible, xsense.h5, zed2i_skeleton3d.h5, events.csv.

Every sample has two stamps: its sensor's and that of its processing, both in seconds of the wall clock (of older files one
only). Versions differ, so things are found by name, and what is absent is no error.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import InputError, needs_extra
from hilbridge.limits import MS

SCENE_WIDTH_PX, SCENE_HEIGHT_PX = 1088, 1080
GAZE, INERTIAL, SKELETON, EVENTS = "gaze.csv", "xsense.h5", "zed2i_skeleton3d.h5", "events.csv"
_GAZE_COLUMNS = ("gaze_x", "gaze_y", "gaze_sensor_timestamps")
_PROCESSED = "gaze_processing_timestamps"
_LIKELY_DELAY_NS = 100 * MS  # a quickest sample later than this is a clock that is off, not a slow sensor


class Stream(NamedTuple):
    """One sensor's samples. `time_ns` is on the clock of the computer that recorded; `shift_ns` was added to get there.

    `lost` counts gaps of the sequence numbers. `delay_ms`: median and 99th percentile from sensor to processing.
    """

    name: str
    time_ns: NDArray[np.int64]
    values: NDArray[np.float64]
    lost: int
    shift_ns: int
    delay_ms: tuple[float, float] | None

    def __str__(self) -> str:
        """Rate, losses, delay and shift in words."""
        text = f"{self.name} {self.rate_hz:.3g} Hz, {self.lost} lost"
        if self.delay_ms is not None:
            text += f", delay {self.delay_ms[0]:.0f} ms (p99 {self.delay_ms[1]:.0f})"
        return f"{text}, clock shifted by {self.shift_ns / MS:+.0f} ms" if self.shift_ns else text

    @property
    def rate_hz(self) -> float:
        span_ns = int(self.time_ns[-1] - self.time_ns[0]) if len(self.time_ns) > 1 else 0
        return (len(self.time_ns) - 1) * 1e9 / span_ns if span_ns > 0 else 0.0


@dataclass(frozen=True, slots=True)
class IAssistRecording:
    """What a folder holds. Values: gaze x, y in 0..1; acceleration x, y, z; wrist x, y, z. events_ns: moments marked."""

    gaze: Stream
    bad_rows: int
    inertial: tuple[Stream, ...]
    wrists: tuple[Stream, ...]
    events_ns: tuple[int, ...]


def is_iassistadl(folder: Path) -> bool:
    """Whether a folder has this layout: by its other files, or the columns of its gaze.csv."""
    if any((folder / name).is_file() for name in (INERTIAL, SKELETON)):
        return True
    try:
        with (folder / GAZE).open(encoding="utf-8-sig") as file:
            return set(_GAZE_COLUMNS) <= set(file.readline().strip().split(","))
    except (OSError, UnicodeDecodeError):
        return False


def read_iassistadl(folder: Path) -> IAssistRecording:
    """Read all that is there. Raises InputError naming file and cure; only gaze has to be there."""
    gaze, bad = _gaze(folder / GAZE)
    inertial = _inertial(folder / INERTIAL) if (folder / INERTIAL).is_file() else ()
    wrists = _wrists(folder / SKELETON) if (folder / SKELETON).is_file() else ()
    return IAssistRecording(gaze, bad, inertial, wrists, _events(folder / EVENTS))


def aligned(name: str, sensor_ns: NDArray[np.int64], processed_ns: NDArray[np.int64] | None) -> tuple[int, Any]:
    """What carries the sensor's stamps to the computer's clock, and the delays (ms) that remain.

    The computer cannot have processed a sample before it was taken. Where the quickest tenth says so, or that even the
    quickest took longer than any sensor here does, the sensor's clock is off by that; a constant delay of less cannot
    be told from an agreeing clock, and counts as delay.
    """
    if processed_ns is None or not len(sensor_ns):
        return 0, None
    late = np.sort(processed_ns - sensor_ns)
    quickest_ns = int(np.median(late[: max(1, len(late) // 100)]))
    shift_ns = 0 if 0 <= quickest_ns <= _LIKELY_DELAY_NS else quickest_ns
    left_ms = (late - shift_ns) / MS
    return shift_ns, (float(np.percentile(left_ms, 50)), float(np.percentile(left_ms, 99)))


def _stream(
    name: str,
    sensor_ns: NDArray[np.int64],
    processed_ns: NDArray[np.int64] | None,
    values: NDArray[np.float64],
    sequence: NDArray[np.int64] | None = None,
) -> Stream:
    shift_ns, delay_ms = aligned(name, sensor_ns, processed_ns)
    steps = np.diff(sequence) if sequence is not None and len(sequence) > 1 else np.empty(0, np.int64)
    lost = int((steps[steps > 1] - 1).sum())
    return Stream(name, sensor_ns + shift_ns, values, lost, shift_ns, delay_ms)


def _gaze(path: Path) -> tuple[Stream, int]:
    rows, bad = [], 0
    names, table = _table(path, "gaze")
    missing = set(_GAZE_COLUMNS) - set(names)
    if missing:
        raise InputError(f"gaze {path}: no column {', '.join(sorted(missing))}; is it the recording's gaze.csv?")
    for cells in table:
        try:
            x, y, seen_s = (float(cells[name] or "") for name in _GAZE_COLUMNS)
            rows.append((x, y, _ns(seen_s), _ns(float(cells.get(_PROCESSED) or seen_s))))
        except (TypeError, ValueError, OverflowError):
            bad += 1
    has_processed = _PROCESSED in names
    if not rows:
        raise InputError(f"gaze {path}: no row could be read ({bad} bad); copy the recording again")
    xs, ys, seen, processed = (np.array(column) for column in zip(*rows, strict=True))
    points = np.column_stack([xs / SCENE_WIDTH_PX, ys / SCENE_HEIGHT_PX])
    return _stream("gaze", seen, processed if has_processed else None, points), bad


def _table(path: Path, what: str) -> tuple[list[str], list[dict[str, str | None]]]:
    """The columns and rows of a CSV whose every line is ended. Raises InputError."""
    try:
        text = path.read_text(encoding="utf-8-sig")
        reader = csv.DictReader(text.splitlines())
        names, table = list(reader.fieldnames or ()), list(reader)
    except FileNotFoundError:
        raise InputError(f"{what} {path}: no such file; a recording of this layout has it there") from None
    except (UnicodeDecodeError, csv.Error, OSError) as error:
        raise InputError(f"{what} {path}: not a CSV text ({error}); copy the recording again") from None
    if not text.endswith("\n"):
        raise InputError(f"{what} {path}: ends in the middle of a line; it is truncated, copy the recording again")
    return names, table


def _ns(seconds: float) -> int:
    if not math.isfinite(seconds):
        raise ValueError
    whole = math.floor(seconds)
    return whole * 1_000_000_000 + round((seconds - whole) * 1e9)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """An HDF5 file; whatever is wrong with it is one line."""
    with needs_extra("iassistadl"):
        import h5py
    try:
        with h5py.File(path, "r") as file:
            yield file
    except InputError:
        raise
    except (OSError, KeyError, RuntimeError, ValueError, TypeError, AttributeError) as error:
        said = str(error).strip("'\"").partition("\n")[0]
        raise InputError(
            f"recording {path}: {said}; the file is truncated or of another layout, copy it again"
        ) from None


def _stamps(group: Any) -> tuple[NDArray[np.int64], NDArray[np.int64] | None]:
    """A group's sensor stamps and those of processing; older files have one, in microseconds."""
    if "Timestamp_Sensor" in group:
        sensor = np.asarray(group["Timestamp_Sensor"], float).ravel()
        processed = (
            np.asarray(group["Timestamp_Processing"], float).ravel() if "Timestamp_Processing" in group else None
        )
        return _ns_array(sensor), None if processed is None else _ns_array(processed)
    return np.round(np.asarray(group["Timestamp"], float).ravel() * 1e3).astype(np.int64), None


def _ns_array(seconds: NDArray[np.float64]) -> NDArray[np.int64]:
    whole = np.floor(seconds)
    return whole.astype(np.int64) * 1_000_000_000 + np.round((seconds - whole) * 1e9).astype(np.int64)


def _inertial(path: Path) -> tuple[Stream, ...]:
    streams = []
    with _opened(path) as file:
        for name, group in file["Sensors"].items():
            sensor_ns, processed_ns = _stamps(group)
            values = np.asarray(group["Accelerometer"], float).T
            if len(values) != len(sensor_ns) or (processed_ns is not None and len(processed_ns) != len(sensor_ns)):
                raise InputError(
                    f"recording {path}: {name} has {len(values)} samples for {len(sensor_ns)} stamps; copy it again"
                )
            sequence = np.asarray(group["SeqID"]).ravel().astype(np.int64) if "SeqID" in group else None
            streams.append(_stream(name, sensor_ns, processed_ns, values, sequence))
    return tuple(streams)


def _wrists(path: Path) -> tuple[Stream, ...]:
    streams = []
    with _opened(path) as file:
        body = file["Skeletons"]["Body_21"]
        stamps = body["Timestamps"] if "Timestamps" in body else file["Timestamps"]
        sensor_ns, processed_ns = _stamps(stamps)
        for name in ("LEFT_WRIST", "RIGHT_WRIST"):
            if name not in body:
                continue
            values = np.asarray(body[name]["SkeletonJoint3d"], float)
            if len(values) != len(sensor_ns):
                raise InputError(
                    f"recording {path}: {name} has {len(values)} samples for {len(sensor_ns)} stamps; copy it again"
                )
            streams.append(_stream(name, sensor_ns, processed_ns, values))
    return tuple(streams)


def _events(path: Path) -> tuple[int, ...]:
    if not path.is_file():
        return ()
    _, table = _table(path, "recording")
    try:
        return tuple(_ns(float(cells["timestamp"] or "")) for cells in table)
    except (KeyError, ValueError, OverflowError):
        raise InputError(f"recording {path}: a row has no `timestamp` in seconds; copy the recording again") from None
