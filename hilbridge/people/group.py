"""Recording folders of the iAssistADL group as sessions: gaze is what the features can use of them, labels.csv what is true.

`events.csv` marks moments without a verb, so it labels nothing; where a folder has no labels.csv that is said.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import InputError
from hilbridge.features.assembler import FeatureAssembler
from hilbridge.features.layout import STEP_NS, D
from hilbridge.features.packs import file_hash
from hilbridge.intent.provenance import Origin
from hilbridge.learning.data.labelled import Spanned, labelled_stream
from hilbridge.learning.data.people import Session
from hilbridge.records import GazeSample, StampSource
from hilbridge.sensors.recorded.iassistadl import GAZE, is_iassistadl, read_iassistadl
from hilbridge.verbs import DEFAULT

LABELS = "labels.csv"
METADATA = "recording_metadata.toml"


def iassistadl_sessions(
    root: Path,
    spans: Callable[[Path], Sequence[Spanned] | None],
    say: Callable[[str], None] = lambda _: None,
    verbs: int = len(DEFAULT),
) -> list[Session]:
    """Every folder of this layout under `root` that has labels (start_ms, end_ms, verb from the first gaze sample)."""
    made = []
    for folder in sorted({path.parent for path in root.rglob(GAZE) if is_iassistadl(path.parent)}):
        own = spans(folder / LABELS)
        if own is None:
            say(f"{folder}: no {LABELS} in it, left out (events.csv names no verb)")
            continue
        values, valid = _features(folder)
        stream = labelled_stream(0, own, values, valid, gaps_are_idle=False, verbs=verbs)
        files = {name: file_hash(folder / name) for name in (GAZE, LABELS)}
        name = "/".join(folder.relative_to(root).parts) or folder.name
        made.append(Session(name, _subject(folder), stream, Origin.RECORDED, files))
    return made


def _features(folder: Path) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    gaze = read_iassistadl(folder).gaze
    first_ns = int(gaze.time_ns[0])
    steps = int((gaze.time_ns[-1] - first_ns) // STEP_NS) + 1
    newest = np.searchsorted(gaze.time_ns, first_ns + np.arange(steps) * STEP_NS, side="right") - 1
    assembler = FeatureAssembler()
    values, valid = np.zeros((steps, D), dtype=np.float32), np.zeros((steps, 3), dtype=bool)
    for step in range(steps):
        place = int(newest[step])
        x, y = (float(number) for number in gaze.values[place])
        stamp_ns = int(gaze.time_ns[place]) - first_ns
        seen = bool(np.isfinite(x) and np.isfinite(y))
        vector = assembler.update(None, GazeSample(stamp_ns, x, y, seen, StampSource.HARDWARE), None, step * STEP_NS)
        values[step], valid[step] = vector.values, vector.valid
    return values, valid


def _subject(folder: Path) -> str:
    """The pseudonym of the metadata, else the folder two above: SUBJECT/SESSION/RECORDING."""
    path = folder / METADATA
    if path.is_file():
        try:
            named = tomllib.loads(path.read_text(encoding="utf-8")).get("settings", {}).get("subject")
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, AttributeError) as error:
            raise InputError(f"{path}: not TOML ({error}); correct it or remove it") from None
        if isinstance(named, str) and named.strip():
            return named.strip()
    return folder.parent.parent.name or folder.name
