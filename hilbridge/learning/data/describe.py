"""`hilbridge data describe PATH`: what is in a folder of the EGTEA Gaze+ package, counted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from hilbridge.features.packs import read_pack
from hilbridge.learning.data.egtea import GAZE, by_session, load_actions, split_counts, verb_counts
from hilbridge.learning.data.sessions import (
    PACKS,
    Discards,
    recorded_sessions,
    session_features,
    session_stream,
    video_path,
)
from hilbridge.sensors.begaze import BegazeRecording, read_begaze
from hilbridge.verbs import VERBS

OUTSIDE = 0.25  # a share of valid gaze beyond the picture's border that is worth a warning


def outside_share(recording: BegazeRecording) -> float:
    """Of valid gaze, how much lies outside of the picture."""
    x, y = recording.x[recording.valid], recording.y[recording.valid]
    return float(((x < 0.0) | (x > 1.0) | (y < 0.0) | (y > 1.0)).mean()) if len(x) else 0.0


def outside_warning(session: str, share: float) -> str:
    """One line of it."""
    return f"{session}: {share:.0%} of its valid gaze is outside of the picture; is it calibrated?"


@dataclass(frozen=True, slots=True)
class GazeFile:
    """One gaze export: samples read, lines that could not be, shares of valid samples and of those outside of the picture,
    its windows."""

    session: str
    version: str
    samples: int
    bad_lines: int
    valid_share: float
    outside_share: float
    minutes: float
    annotated: bool
    windows: Discards


@dataclass(frozen=True, slots=True)
class DataSummary:
    """What `describe` found; counts are of annotated actions unless the name says otherwise."""

    path: str
    annotations: int
    sessions: int
    subjects: int
    verbs: int
    by_verb: Mapping[str, int]
    by_class: Mapping[str, int]
    splits: Mapping[str, int]
    overlapping: int
    gaze: tuple[GazeFile, ...]
    videos: int
    packs: int
    pack_windows: Mapping[str, Discards]

    def as_json(self) -> dict[str, Any]:
        """Plain types for json.dumps."""
        return asdict(self)

    def lines(self) -> list[str]:
        """For people."""
        made = [
            f"{self.path}",
            f"  {self.annotations} annotations, {self.sessions} sessions, {self.subjects} subjects, {self.verbs} verbs",
            "  " + ", ".join(f"{verb} {count}" for verb, count in self.by_verb.items()),
            f"  as {len(VERBS)} classes: " + ", ".join(f"{verb} {count}" for verb, count in self.by_class.items()),
            f"  {self.overlapping} actions begin before the one before has ended",
            "  splits: " + (", ".join(f"{name} {count}" for name, count in self.splits.items()) or "none"),
            f"  {len(self.gaze)} gaze files, {sum(file.bad_lines for file in self.gaze)} bad lines, "
            f"{self.videos} videos, {self.packs} feature packs",
        ]
        for file in self.gaze:
            made.append(
                f"    {file.session}: BeGaze {file.version}, {file.samples} samples ({file.valid_share:.1%} valid), "
                f"{file.minutes:.1f} min, {file.bad_lines} bad lines; {_windows(file.windows)}"
            )
        for name, windows in self.pack_windows.items():
            made.append(f"    pack {name}: {_windows(windows)}")
        return [*made, *(f"  warning: {text}" for text in self.warnings())]

    def warnings(self) -> list[str]:
        """What to know before training on it."""
        made = [outside_warning(file.session, file.outside_share) for file in self.gaze if file.outside_share > OUTSIDE]
        made += [
            f"{file.session}: ends before {file.windows.after_the_recording} of {file.windows.onsets} annotated actions"
            for file in self.gaze
            if file.windows.after_the_recording
        ]
        made += [f"{file.session}: recorded, but nobody annotated it" for file in self.gaze if not file.annotated]
        return made


def describe(path: Path) -> DataSummary:
    """Count everything under `path`. Raises DatasetError or BegazeError naming the file and the cure."""
    actions = load_actions(path)
    sessions = by_session(actions)
    files = []
    for file in sorted((path / GAZE).glob("*.txt")):
        recording = read_begaze(file)
        steps = int(recording.frame[-1] * 25 // 24) + 1
        counts = Discards()
        if file.stem in sessions:
            values, valid = session_features(steps, recording)
            counts = session_stream(0, sessions[file.stem], values, valid)[2]
        files.append(
            GazeFile(
                file.stem,
                recording.version,
                len(recording.x),
                recording.bad_lines,
                round(float(recording.valid.mean()), 4),
                round(outside_share(recording), 4),
                round(float(recording.video_s()[-1]) / 60.0, 2),
                file.stem in sessions,
                counts,
            )
        )
    packs = {
        file.stem: session_stream(0, sessions[file.stem], *read_pack(file))[2] if file.stem in sessions else Discards()
        for file in sorted((path / PACKS).glob("*.npz"))
    }
    classes = np.bincount([action.label for action in actions], minlength=len(VERBS))
    return DataSummary(
        path=str(path),
        annotations=len(actions),
        sessions=len(sessions),
        subjects=len({action.subject for action in actions}),
        verbs=len({action.verb for action in actions}),
        by_verb=verb_counts(actions),
        by_class={verb: int(count) for verb, count in zip(VERBS, classes, strict=True)},
        splits=split_counts(path),
        overlapping=sum(
            after.start_ms < before.end_ms for session in sessions.values() for before, after in pairwise(session)
        ),
        gaze=tuple(files),
        videos=sum(video_path(path, name) is not None for name in recorded_sessions(path)),
        packs=len(packs),
        pack_windows=packs,
    )


def _windows(counts: Discards) -> str:
    why = {
        "too early": counts.too_early,
        "after the recording": counts.after_the_recording,
        "too few valid steps": counts.too_few_valid,
    }
    lost = ", ".join(f"{number} {reason}" for reason, number in why.items() if number)
    return f"{counts.kept} of {counts.onsets} windows kept" + (f" (discarded: {lost})" if lost else "")
