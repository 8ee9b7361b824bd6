"""Believed history in the closed loop: chosen on validation people, judged on test people, through the same gate.

No label of the past is used: `HistoryFilter` takes what came before from the belief itself. The transitions are those of
the annotations' aggregates, by which the simulated wearer lives; so what this shows is an upper bound for real people.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hilbridge.intent.calibration import softmax
from hilbridge.intent.history import HistoryFilter, HistoryPrior
from hilbridge.learning import metrics
from hilbridge.learning.data.stream import Stream
from hilbridge.wearer.timeline import statistics

Floats = NDArray[np.float64]
TRUSTS: tuple[float, ...] = (0.02, 0.05, 0.1, 0.2, 0.4)
HAZARDS: tuple[float, ...] = (0.004, 0.007, 0.012)
THIN = 12  # every 12th step is fitted on: neighbours are near copies


@dataclass(frozen=True, slots=True)
class FittedHistory:
    """The filter's setting, from validation people."""

    trust: float
    hazard: float
    validation_nll: float
    alone_nll: float


def filtered(logits: Floats, stream: Stream, temperature: float, trust: float, hazard: float) -> Floats:
    """Belief (N, K) at each step; NaN where there are no logits (the filter starts anew after such a gap)."""
    table = statistics()
    engine = HistoryFilter(HistoryPrior(table.transitions, table.start, table.prior, trust), hazard)
    made = np.full(logits.shape, np.nan)
    for index, row in enumerate(logits):
        changed = index and stream.subject[index] != stream.subject[index - 1]
        if np.isnan(row[0]) or changed:
            engine.reset()
        if not np.isnan(row[0]):
            made[index] = engine.step(softmax(row / temperature))
    return made


def fit_history(logits: Floats, stream: Stream, temperature: float) -> FittedHistory:
    """The setting with the lowest NLL on steps at which the wearer is busy with something."""
    judged = np.flatnonzero(~np.isnan(logits[:, 0]) & (stream.event >= 0))[::THIN]
    labels = stream.label[judged]
    alone = metrics.nll(softmax(logits[judged] / temperature), labels)
    best: tuple[float, float, float] | None = None
    for trust in TRUSTS:
        for hazard in HAZARDS:
            belief = filtered(logits, stream, temperature, trust, hazard)[judged]
            loss = metrics.nll(belief, labels)
            if best is None or loss < best[0]:
                best = (loss, trust, hazard)
    assert best is not None
    loss, trust, hazard = best
    return FittedHistory(trust, hazard, loss, alone)
