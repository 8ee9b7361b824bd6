"""The layout of the feature vector x_t: the single source of every index (paper, "Inputs and Encoder").

Everything that reads or writes an entry of `FeatureVector.values` asks this table; bundles carry `LAYOUT_HASH`, so a
network trained on another layout is refused instead of fed with wrong numbers. docs/features.md is generated from it.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hilbridge.limits import TICK_NS
from hilbridge.records import Modality

HUE_BINS = 12
SATURATION_BINS = 4
VALUE_BINS = 4
MAX_HANDS = 2
RATE_HZ = 25.0
STEP_NS = TICK_NS


@dataclass(frozen=True, slots=True)
class Entry:
    """One number of the feature vector: where it stands, what it is called, its unit and what it depends on."""

    index: int
    name: str
    unit: str
    modality: Modality


def _names() -> list[tuple[str, str, Modality]]:
    gaze = [
        ("gaze_x", "picture widths from the left", Modality.GAZE),
        ("gaze_y", "picture heights from the top", Modality.GAZE),
        ("gaze_valid", "0 or 1", Modality.GAZE),
        ("gaze_dx", "picture widths per second", Modality.GAZE),
        ("gaze_dy", "picture heights per second", Modality.GAZE),
    ]
    hands = [
        (f"hand{slot}_{part}", unit, Modality.HANDS)
        for slot in range(MAX_HANDS)
        for part, unit in (
            ("present", "0 or 1"),
            ("x", "picture widths from the left"),
            ("y", "picture heights from the top"),
            ("vx", "picture widths per second"),
            ("vy", "picture heights per second"),
        )
    ]
    scene = [
        (f"{area}_{channel}{number}", "square root of the share of weight", Modality.SCENE)
        for area in ("frame", "patch")
        for channel, bins in (("hue", HUE_BINS), ("saturation", SATURATION_BINS), ("value", VALUE_BINS))
        for number in range(bins)
    ]
    return [*gaze, *hands, *scene]


LAYOUT: tuple[Entry, ...] = tuple(
    Entry(index, name, unit, modality) for index, (name, unit, modality) in enumerate(_names())
)
D = len(LAYOUT)
LAYOUT_HASH = hashlib.sha256(
    "\n".join(f"{entry.index} {entry.name} [{entry.unit}] {entry.modality.name}" for entry in LAYOUT).encode()
).hexdigest()

MODALITY_OF: NDArray[np.int64] = np.array([int(entry.modality) for entry in LAYOUT], dtype=np.int64)
GAZE = slice(0, 5)
HANDS = slice(5, 5 + 5 * MAX_HANDS)
HISTOGRAM_BINS = HUE_BINS + SATURATION_BINS + VALUE_BINS
FRAME = slice(HANDS.stop, HANDS.stop + HISTOGRAM_BINS)
PATCH = slice(FRAME.stop, FRAME.stop + HISTOGRAM_BINS)


def drop_modality(values: NDArray[np.float32], valid: NDArray[np.bool_], modality: Modality) -> None:
    """Do in place to recorded steps what losing `modality` does to live ones.

    values: (..., D) raw features; valid: (..., 3) u_t. Without gaze there is no patch to look at, so the assembler
    fills the patch histogram with the whole frame's; training with modality dropout has to see just that.
    """
    valid[..., int(modality)] = False
    values[..., int(modality) == MODALITY_OF] = 0.0
    if modality is Modality.GAZE:
        values[..., PATCH] = values[..., FRAME]


def markdown_table() -> str:
    """The layout as docs/features.md shows it."""
    lines = ["| index | name | unit | modality |", "|---:|---|---|---|"]
    lines += [f"| {entry.index} | {entry.name} | {entry.unit} | {entry.modality.name.lower()} |" for entry in LAYOUT]
    return "\n".join(lines) + "\n"
