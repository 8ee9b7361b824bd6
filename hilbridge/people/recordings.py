"""Labelled recordings of the bridge as sessions of people: /features on a 25 Hz grid, /label laid over it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import InputError
from hilbridge.features.layout import STEP_NS, D
from hilbridge.features.packs import file_hash
from hilbridge.intent.provenance import Origin
from hilbridge.labels.store import beside
from hilbridge.labels.table import read_csv, words_at
from hilbridge.learning.data.labelled import Spanned, labelled_stream
from hilbridge.learning.data.people import USUAL, Naming, Session
from hilbridge.limits import GAP_NS
from hilbridge.observe.parts import recordings_in
from hilbridge.observe.reading import read_recording
from hilbridge.rows import FeaturesRow, LabelRow, MetaRow

_TOPICS = (MetaRow.topic, FeaturesRow.topic, LabelRow.topic)
_CARRIED = GAP_NS // STEP_NS  # steps that the newest features stand for what came late


def recorded_session(place: Path, naming: Naming = USUAL) -> Session | None:
    """One recording (a file, or a run's folder); None where nobody labelled it. Raises InputError."""
    meta: MetaRow | None = None
    features: list[FeaturesRow] = []
    labels: list[LabelRow] = []
    begin_ns: int | None = None
    for row in read_recording(place, _TOPICS):
        begin_ns = row.time_ns if begin_ns is None else begin_ns
        if isinstance(row, MetaRow):
            meta = meta or row
        elif isinstance(row, FeaturesRow):
            features.append(row)
        elif isinstance(row, LabelRow):
            labels.append(row)
    if not features or begin_ns is None:
        raise InputError(f"recording {place}: has no /features; only runs of the bridge recorded from now on do")
    first_ns = features[0].captured_ns
    spans = [
        naming.span(row.verb, (row.time_ns - first_ns) / 1e6, (row.end_ns - first_ns) / 1e6, str(place))
        for row in sorted(labels, key=lambda row: row.time_ns)
    ]
    files = recordings_in([place])
    if not spans:
        spans = _labels_beside(place, (begin_ns - first_ns) / 1e6, naming)
        files += [beside(place)] if spans else []
    if not spans:
        return None
    values, valid = on_grid(features)
    stream = labelled_stream(0, spans, values, valid, gaps_are_idle=False, verbs=len(naming.vocabulary))
    hashes = {path.name: file_hash(path) for path in files}
    return Session(_name(place), _person(place, meta), stream, origin_of(meta), hashes)


def _labels_beside(place: Path, shift_ms: float, naming: Naming) -> list[Spanned]:
    path = beside(place)
    if not path.is_file():
        return []
    labels = read_csv(path, words_at(path, *naming.vocabulary.names))
    return [naming.span(one.verb, one.start_ms + shift_ms, one.end_ms + shift_ms, str(path)) for one in labels]


def _name(place: Path) -> str:
    return place.name if place.is_dir() else place.stem if place.stem != "recording" else place.parent.name


def _person(place: Path, meta: MetaRow | None) -> str:
    return meta.participant if meta is not None and meta.participant else _name(place)


def origin_of(meta: MetaRow | None) -> Origin:
    """A person's only where a camera or an eye tracker was there, and no scenario played the wearer."""
    looked = meta is not None and (meta.camera is not None or meta.gaze is not None) and meta.scenario is None
    return Origin.RECORDED if looked else Origin.SIMULATED


def on_grid(features: Sequence[FeaturesRow]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """(N, D) and (N, 3) every 40 ms from the first features on: the newest ones, for as long as the bridge would believe
    them; after that nothing, which is what it saw."""
    captured = np.array([row.captured_ns for row in features])
    order = np.argsort(captured, kind="stable")
    captured = captured[order]
    steps = int((captured[-1] - captured[0]) // STEP_NS) + 1
    # Half a step of tolerance: pictures of a camera at 25 Hz come a little early or late.
    now = captured[0] + np.arange(steps) * STEP_NS + STEP_NS // 2
    newest = np.searchsorted(captured, now, side="right") - 1
    fresh = now - captured[newest] <= _CARRIED * STEP_NS + STEP_NS // 2
    values = np.zeros((steps, D), dtype=np.float32)
    valid = np.zeros((steps, 3), dtype=bool)
    for step in np.flatnonzero(fresh):
        row = features[int(order[newest[step]])]
        values[step] = row.values
        valid[step] = (row.gaze_valid, row.hands_valid, row.scene_valid)
    return values, valid
