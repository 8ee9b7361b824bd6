"""`hilbridge data simulate`: simulated people as labelled recordings, to try the way from recordings to a bundle.

The rows are those of the live bridge (/meta, /features, /label); their origin says simulated, and so will any bundle made
of them: no such bundle may act on a physical bus.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import hilbridge
from hilbridge.errors import InputError
from hilbridge.features.assembler import FeatureAssembler
from hilbridge.features.layout import STEP_NS
from hilbridge.labels.store import beside
from hilbridge.labels.table import Label, as_row, csv_text
from hilbridge.limits import MS
from hilbridge.observe.recording import AddsNothing, Recording
from hilbridge.rows import MetaRow
from hilbridge.rows.senses import Look, features_row
from hilbridge.verbs import NONE, VERBS
from hilbridge.wearer.person import Wearer
from hilbridge.wearer.timeline import BENCHMARK, DEMO, Difficulty, hiding

FIRST_SEED = 30_000  # nobody that any bundle here was trained or certified on
SOURCE = "simulated"


def difficulty_named(name: str) -> Difficulty:
    """Raises InputError naming those there are."""
    known = {one.name: one for one in (DEMO, BENCHMARK, hiding(DEMO), hiding(BENCHMARK))}
    if name not in known:
        raise InputError(f"--wearer {name}: must be one of {', '.join(known)}")
    return known[name]


def simulate(
    out: Path, people: int, seconds: float, difficulty: Difficulty, first_seed: int, progress: Callable[[], None]
) -> list[Path]:
    """One folder a person, S-SEED/recording.mcap. Raises InputError where one is there already."""
    made = []
    for seed in range(first_seed, first_seed + people):
        folder = out / f"S-{seed}"
        if (folder / "recording.mcap").exists():
            raise InputError(f"{folder}: holds a recording already; name another folder")
        folder.mkdir(parents=True, exist_ok=True)
        made.append(_record(folder / "recording.mcap", seed, seconds, difficulty))
        progress()
    return made


def _record(path: Path, seed: int, seconds: float, difficulty: Difficulty) -> Path:
    wearer = Wearer(seed, difficulty=difficulty, width_px=96, height_px=72)
    assembler = FeatureAssembler()
    labels = labels_of(wearer, seconds)
    with Recording(path, AddsNothing()) as recording:
        recording.write(
            MetaRow(0, title=f"simulated wearer {seed}", participant=f"S-{seed}", version=hilbridge.__version__)
        )
        for step in range(round(seconds * 1e9 / STEP_NS)):
            now_ns = step * STEP_NS
            gaze, hands = wearer.gaze(now_ns), wearer.hands(now_ns)
            vector = assembler.update(wearer.frame(now_ns), gaze, hands, now_ns)
            recording.write(features_row(Look(now_ns, vector, step, gaze, hands)))
        for label in labels:
            recording.write(as_row(label, 0))
    beside(path).write_text(csv_text(labels), encoding="utf-8")
    return path


def labels_of(wearer: Wearer, seconds: float) -> list[Label]:
    """What an observer who sees the hands would write down: each verb while it is under way, nothing in between."""
    end_ms = seconds * 1e3
    made, at_ms = [], 0.0
    events = wearer.events(round(seconds * 1e9))
    for place, event in enumerate(events):
        start_ms = event.start_ns / MS
        until_ms = event.end_ns / MS
        if place + 1 < len(events):  # an observer names one thing at a time
            until_ms = min(until_ms, events[place + 1].start_ns / MS)
        until_ms = min(until_ms, end_ms)
        if start_ms > at_ms:
            made.append(Label(round(at_ms, 3), round(start_ms, 3), NONE, SOURCE))
        if until_ms > start_ms:
            made.append(Label(round(start_ms, 3), round(until_ms, 3), VERBS[event.verb], SOURCE))
        at_ms = until_ms
    if end_ms > at_ms:
        made.append(Label(round(at_ms, 3), round(end_ms, 3), NONE, SOURCE))
    return made
