"""Streams of features from simulated wearers: the demo bundle's training set and the synthetic benchmark.

A stream runs through the very FeatureAssembler that runs live; only the pictures are smaller (72 rows: what the scene
features shrink any picture to), so there is no second feature path that could differ.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from dataclasses import fields
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from hilbridge.errors import InputError
from hilbridge.features.assembler import FeatureAssembler
from hilbridge.features.layout import LAYOUT_HASH, STEP_NS, D
from hilbridge.files import in_place_of
from hilbridge.learning.data.stream import Stream, join
from hilbridge.wearer.person import Wearer
from hilbridge.wearer.shaking import Tremor, tremor_of
from hilbridge.wearer.timeline import Difficulty, bayes_posterior, statistics

# 2 s windows that end up to 0.76 s before an onset, and 0.8 s for the filters to settle in.
BEFORE_ONSET_STEPS = 88


def record(
    seed: int, difficulty: Difficulty, seconds: float, tremor: Tremor | None = None, whole_seconds: float | None = None
) -> Stream:
    """`seconds` of the person `seed` at 25 Hz.

    whole_seconds: after so much of the stream, leave out (invalid, zero) every step that no window ending 0.5 to 0.8 s
    before an onset looks at, which more than halves the work for windows (None: leave nothing out).
    """
    wearer = Wearer(seed, difficulty=difficulty, tremor=tremor, width_px=96, height_px=72)
    assembler = FeatureAssembler()
    steps = round(seconds * 1e9 / STEP_NS)
    prior = statistics().prior
    stream = Stream(
        np.full(steps, seed),
        np.zeros((steps, D), dtype=np.float32),
        np.zeros((steps, 3), dtype=bool),
        np.full(steps, -1),
        np.full(steps, -1),
        np.full(steps, -1),
        np.full(steps, -1),
        np.full(steps, -1),
        np.zeros((steps, len(prior)), dtype=np.float32),
        np.ones(steps, dtype=bool),
    )
    for step in range(steps):
        t_ns = step * STEP_NS
        truth = wearer.truth(t_ns)
        onset_steps = (truth.onset_ns - t_ns) // STEP_NS
        left_out = whole_seconds is not None and t_ns >= whole_seconds * 1e9
        if left_out and not 12 <= onset_steps <= BEFORE_ONSET_STEPS:
            stream.onset_steps[step] = onset_steps
            continue
        vector = assembler.update(wearer.frame(t_ns), wearer.gaze(t_ns), wearer.hands(t_ns), t_ns)
        stream.values[step] = vector.values
        stream.valid[step] = vector.valid
        stream.label[step] = truth.following if truth.intended is None else truth.intended
        stream.current[step] = -1 if truth.current is None else truth.current
        stream.onset_steps[step] = onset_steps
        busy = wearer.busy_with(t_ns)
        stream.bayes[step] = prior
        if busy is not None:
            stream.event[step] = busy.index
            stream.busy_steps[step] = (t_ns - busy.prepare_ns) // STEP_NS
            clear = difficulty.mean if difficulty.hidden else busy.clarity  # what is shown says nothing of a hidden one
            stream.bayes[step] = bayes_posterior(busy.shown, clear, prior)
    return stream


def record_people_with(seeds: Iterable[int], difficulty: Difficulty, seconds: float, tremor: Tremor | None) -> Stream:
    """Streams of many people who may have a tremor (not kept: these are few and short)."""
    return join(record(seed, difficulty, seconds, tremor) for seed in seeds)


def record_people(
    seeds: Iterable[int],
    difficulty: Difficulty,
    seconds: float,
    cache: Path | None = None,
    progress: Callable[[], None] = lambda: None,
    whole_seconds: float | None = None,
    trembling_every: int | None = None,
) -> Stream:
    """Streams of many people, kept in `cache` (one npz per person) so that an interrupted run goes on where it was.

    trembling_every: every so many of them tremble, as `tremor_of` has it.
    """
    cut = "" if whole_seconds is None else f"-{whole_seconds:g}whole{BEFORE_ONSET_STEPS}"
    kind = hashlib.sha256(f"{LAYOUT_HASH} {difficulty}".encode()).hexdigest()[
        :12
    ]  # other features or people: not these
    parts = []
    for seed in seeds:
        tremor = tremor_of(seed) if trembling_every is not None and seed % trembling_every == 0 else None
        shaking = "" if tremor is None else f"-tremor{hashlib.sha256(repr(tremor).encode()).hexdigest()[:6]}"
        path = None if cache is None else cache / f"{difficulty.name}{cut}{shaking}-{seed}-{seconds:g}s-{kind}.npz"
        if path is not None and path.is_file():
            part = _cached(path)
        else:
            part = record(seed, difficulty, seconds, tremor, whole_seconds)
            if path is not None:
                with in_place_of(path) as partial, partial.open("wb") as file:
                    np.savez_compressed(file, **{field.name: getattr(part, field.name) for field in fields(Stream)})
        parts.append(part)
        progress()
    return join(parts)


def _cached(path: Path) -> Stream:
    try:
        with np.load(path) as stored:
            return Stream(*(stored[field.name] for field in fields(Stream)))
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        raise InputError(f"{path}: not a stream of ours; remove it, and that person is recorded anew") from None
