"""2 s windows out of 25 Hz streams, without ever copying the stream (paper, "Dataset, Task, Splits")."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hilbridge.features.layout import MODALITY_OF, drop_modality
from hilbridge.intent.predictor import MIN_USABLE_SHARE
from hilbridge.intent.standardise import standardise
from hilbridge.learning.data.stream import Stream
from hilbridge.records import Modality

STEPS = 50
STD_FLOOR = 0.03  # a histogram bin that never moved in training must not explode when it does


@dataclass(frozen=True, slots=True)
class Statistics:
    """Training mean and standard deviation of the raw features, (D,) each."""

    mean: NDArray[np.float32]
    std: NDArray[np.float32]


def training_statistics(values: NDArray[np.float32], valid: NDArray[np.bool_]) -> Statistics:
    """Over valid steps only: values (N, D), valid (N, 3)."""
    weight = valid[:, MODALITY_OF].astype(np.float64)
    count = np.maximum(weight.sum(axis=0), 1.0)
    mean = (values * weight).sum(axis=0) / count
    variance = (((values - mean) ** 2) * weight).sum(axis=0) / count
    return Statistics(mean.astype(np.float32), np.maximum(np.sqrt(variance), STD_FLOOR).astype(np.float32))


def window_ends(stream: Stream, every: int = 1) -> NDArray[np.int64]:
    """Indices at which a whole window of one person ends with enough usable steps, thinned to every n-th."""
    ends = np.arange(STEPS - 1, len(stream))
    one_person = stream.subject[ends] == stream.subject[ends - (STEPS - 1)]
    usable = np.concatenate([[0], np.cumsum(stream.valid.any(axis=1))])
    enough = usable[ends + 1] - usable[ends + 1 - STEPS] >= MIN_USABLE_SHARE * STEPS
    return np.asarray(ends[one_person & enough][::every])


def onset_ends(stream: Stream, lead_steps: int = 13) -> NDArray[np.int64]:
    """The paper's windows: those that end `lead_steps` (0.52 s) before an onset, one per action."""
    ends = window_ends(stream)
    return np.asarray(ends[stream.onset_steps[ends] == lead_steps])


def gather(
    stream: Stream,
    ends: NDArray[np.int64],
    statistics: Statistics,
    lost: tuple[Modality, ...] = (),
    rng: np.random.Generator | None = None,
    dropout: float = 0.0,
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Windows as the network takes them: x (B, T, D) z-scored, usable (B, T).

    lost: modalities taken away from all windows. dropout: the chance per window to lose one or two modalities drawn
    by `rng` (modality dropout of training, paper).
    """
    rows = ends[:, None] + np.arange(1 - STEPS, 1)
    values, valid = stream.values[rows], stream.valid[rows]
    for modality in lost:
        drop_modality(values, valid, modality)
    if rng is not None and dropout > 0.0:
        hit = rng.uniform(size=len(ends)) < dropout
        chosen = rng.integers(1, 7, size=len(ends))  # any set of modalities but none and all
        for modality in Modality:
            index = np.flatnonzero(hit & (chosen >> int(modality) & 1 == 1))
            part, part_valid = values[index], valid[index]
            drop_modality(part, part_valid, modality)
            values[index], valid[index] = part, part_valid
    return standardise(values, valid, statistics.mean, statistics.std), valid.any(axis=-1)
