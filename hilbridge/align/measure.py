"""The offset of one source of a recording from its camera, and the line of the configuration that mends it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hilbridge.align.events import claps, flashes, impacts, saccades
from hilbridge.align.pairing import Offset, constant_offset
from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.observe.keeping.pictures import camera_frame, scene_frame
from hilbridge.observe.reading import read_recording
from hilbridge.rows import GazeRow, HandsRow, ImageRow, InertialRow, SceneRow

SACCADE_LATENCY_MS = 200.0  # from a flash to the eye's movement towards it; people differ by 30 ms


class By(StrEnum):
    """What was done in front of the camera."""

    CLAP = "clap"
    FLASH = "flash"


@dataclass(frozen=True, slots=True)
class Alignment:
    """`key` of [sensors] and its value: what has to be added to the source's stamps."""

    key: str
    offset: Offset
    value_ms: float
    what: str

    def line(self) -> str:
        """For bridge.toml."""
        spread, error = self.offset.spread_ns / MS, self.offset.error_ns / MS
        told = f"{self.offset.pairs} {self.what}, spread {spread:.0f} ms, error {error:.0f} ms"
        return f"{self.key} = {self.value_ms:.1f}  # {told}"


def measure(recording: Path, by: By, latency_ms: float = SACCADE_LATENCY_MS) -> Alignment:
    """Read a run's recording. Raises InputError where it cannot be told."""
    return _by_flash(recording, latency_ms) if by is By.FLASH else _by_clap(recording)


def _by_flash(recording: Path, latency_ms: float) -> Alignment:
    """A saccade follows a flash by `latency_ms`; what is more is how late gaze is stamped."""
    seen, looked = [], []
    for row in read_recording(recording, (SceneRow.topic, ImageRow.topic, GazeRow.topic)):
        if isinstance(row, SceneRow):
            seen.append((row.captured_ns, float(scene_frame(row).pixels.mean()), 1))
        elif isinstance(row, ImageRow):
            seen.append((row.captured_ns, float(camera_frame(row).pixels.mean()), 0))
        elif isinstance(row, GazeRow) and row.valid and row.x is not None and row.y is not None:
            looked.append((row.captured_ns, row.x, row.y))
    exact = [one for one in seen if one[2]] or seen
    if len(exact) < 3 or len(looked) < 4:
        raise InputError(
            f"recording {recording}: {len(exact)} pictures and {len(looked)} valid gaze samples; record it with video and gaze"
        )
    times, x, y = _columns(looked)
    picture_ns, brightness, _ = _columns([(when, mean, 0.0) for when, mean, _ in exact])
    latency_ns = round(latency_ms * MS)
    found = constant_offset(
        flashes(picture_ns, brightness), saccades(times, x, y), latency_ns, "flashes and saccades to them"
    )
    return Alignment("gaze_offset_ms", found, (latency_ns - found.offset_ns) / MS, "flashes")


def _by_clap(recording: Path) -> Alignment:
    """An inertial sensor on a hand is struck at the moment in which the palms meet in the picture."""
    met, felt = [], []
    for row in read_recording(recording, (HandsRow.topic, InertialRow.topic)):
        if isinstance(row, HandsRow):
            met.append((row.captured_ns, _apart(row), 0.0))
        elif isinstance(row, InertialRow) and row.valid and "hand" in row.sensor.lower():
            felt.append((row.captured_ns, row.x, row.y, row.z, row.sensor))
    if not met or not felt:
        raise InputError(
            f"recording {recording}: {len(met)} pictures with hands and {len(felt)} samples of an inertial sensor on a hand; "
            "record it with --inertial and hands"
        )
    sensor = felt[0][4]
    of_one = [one for one in felt if one[4] == sensor]
    times = np.array([one[0] for one in of_one], np.int64)
    struck = impacts(times, np.array([one[1:4] for one in of_one]))
    picture_ns, apart, _ = _columns(met)
    found = constant_offset(claps(picture_ns, apart), struck, 0, "claps and impacts")
    return Alignment("inertial_offset_ms", found, -found.offset_ns / MS, "claps")


def _apart(row: HandsRow) -> float:
    places = [(hand.x, hand.y) for hand in row.hands if hand.x is not None and hand.y is not None]
    return math.dist(*places) if len(places) == 2 else math.nan


def _columns(
    rows: list[tuple[int, float, float]],
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Times, and two columns, in the order of time without repetitions."""
    ordered = sorted(rows, key=lambda row: row[0])
    kept = ordered[:1] + [later for earlier, later in pairwise(ordered) if later[0] > earlier[0]]
    times, first, second = zip(*kept, strict=True)
    return np.array(times, np.int64), np.array(first, float), np.array(second, float)
