"""Recordings of the iAssistADL group as sessions: SUBJECT/SESSION/RECORDING folders, their gaze at 25 Hz.

Hands and scene are masked: where a skeleton lies in the picture is no part of a recording, nor is the eye tracker's picture.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hilbridge.features.assembler import FeatureAssembler
from hilbridge.features.layout import STEP_NS, D
from hilbridge.records import GazeSample, StampSource
from hilbridge.sensors.gaze import iassistadl_recording
from hilbridge.sensors.recorded.iassistadl import GAZE, is_iassistadl

_DEPTHS = ("", "*/", "*/*/", "*/*/*/")


def recording_folders(root: Path) -> dict[str, Path]:
    """Recordings under a folder, itself included, by their names: the folders down to it, joined by dots."""
    folders = {path.parent for depth in _DEPTHS for path in root.glob(f"{depth}{GAZE}")}
    found = {}
    for folder in sorted(folders):
        if is_iassistadl(folder):
            found[".".join(folder.relative_to(root).parts) or folder.name] = folder
    return found


def recording_features(folder: Path) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """One recording through the project's own feature chain: (N, D) values, (N, 3) valid. Raises InputError."""
    gaze = iassistadl_recording(folder)
    steps = int(gaze.time_ns[-1] // STEP_NS) + 1
    newest = np.searchsorted(gaze.time_ns, np.arange(steps) * STEP_NS, side="right") - 1
    values, valid = np.zeros((steps, D), np.float32), np.zeros((steps, 3), bool)
    assembler = FeatureAssembler()
    for step, row in enumerate(newest.tolist()):
        sample = None
        if row >= 0:
            x, y, good = float(gaze.x[row]), float(gaze.y[row]), bool(gaze.valid[row])
            sample = GazeSample(int(gaze.time_ns[row]), x, y, good, StampSource.HARDWARE)
        vector = assembler.update(None, sample, None, step * STEP_NS)
        values[step], valid[step] = vector.values, vector.valid
    return values, valid
