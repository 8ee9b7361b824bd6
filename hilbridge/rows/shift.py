"""Moves rows along the clock: every stamp of a row, so that what belongs together still does."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from hilbridge.rows.bus import CanRow
from hilbridge.rows.code import Row
from hilbridge.rows.decisions import BeliefRow, TickRow
from hilbridge.rows.run import LabelRow
from hilbridge.rows.senses import (
    FeaturesRow,
    GazeRow,
    HandsRow,
    ImageRow,
    InertialRow,
    SceneRow,
    SkeletonRow,
    image_stamp,
)

_STAMPS: dict[type[Any], tuple[str, ...]] = {
    TickRow: ("features_ns",),
    BeliefRow: ("oldest_input_ns", "produced_ns"),
    FeaturesRow: ("captured_ns", "oldest_input_ns", "gaze_ns", "hands_ns"),
    ImageRow: ("captured_ns",),
    SceneRow: ("captured_ns",),
    GazeRow: ("captured_ns",),
    HandsRow: ("captured_ns",),
    InertialRow: ("captured_ns",),
    SkeletonRow: ("captured_ns",),
    LabelRow: ("end_ns",),
}


def shifted(row: Row, by_ns: int) -> Row:
    """The row `by_ns` later. A recording has no time before 0: what would come there comes at 0."""
    stamps: dict[str, Any] = {
        name: value + by_ns for name in _STAMPS.get(type(row), ()) if (value := getattr(row, name)) is not None
    }
    if isinstance(row, CanRow) and row.received_ns:
        stamps["received_ns"] = max(1, row.received_ns + by_ns)  # 0 is none
    if isinstance(row, ImageRow):
        stamps["timestamp"] = image_stamp(stamps["captured_ns"])
    return replace(row, time_ns=max(0, row.time_ns + by_ns), **stamps)
