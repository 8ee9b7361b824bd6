"""Streams through the numpy engine and the real gate, offline: thresholds and E5 stand on the code that runs live."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hilbridge.core.gate import GateConfig, GateState, step
from hilbridge.core.gate_figures import GateFigures, GateTick, gate_figures
from hilbridge.features.layout import STEP_NS, drop_modality
from hilbridge.intent.calibration import Calibration
from hilbridge.intent.gru import StreamingGru, Weights
from hilbridge.intent.standardise import standardise
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.data.windows import STEPS, Statistics
from hilbridge.records import Action, IntentEstimate, Modality


def stream_logits(
    weights: Weights, stream: Stream, statistics: Statistics, lost: tuple[Modality, ...] = ()
) -> NDArray[np.float64]:
    """Logits (N, K) of the window that ends at each step; NaN where no whole window of one person ends."""
    values, valid = stream.values, stream.valid
    if lost:
        values, valid = values.copy(), valid.copy()
        for modality in lost:
            drop_modality(values, valid, modality)
    x = standardise(values, valid, statistics.mean, statistics.std)
    usable = np.asarray(valid.any(axis=1))
    engine = StreamingGru(weights, STEPS)
    logits = np.full((len(stream), weights.head_bias.shape[0]), np.nan)
    person: int | None = None
    for index in range(len(stream)):
        if stream.subject[index] != person:
            engine.reset()
            person = int(stream.subject[index])
        out = engine.step(x[index], bool(usable[index]))
        if out is not None:
            logits[index] = out
    return logits


@dataclass(frozen=True, slots=True)
class Replay:
    """What the gate did, per step: acting (N,), the verb acted on (N,) or -1 under HOLD, right (N,) as the truth judges."""

    acting: NDArray[np.bool_]
    verb: NDArray[np.int64]
    right: NDArray[np.bool_]

    @property
    def figures(self) -> GateFigures:
        """Counts over all steps, by the one definition."""
        steps = zip(self.verb.tolist(), self.right.tolist(), strict=True)
        return gate_figures(GateTick(verb, right) if verb >= 0 else GateTick(None, None) for verb, right in steps)

    @property
    def coverage(self) -> float:
        """Share of steps in ACT."""
        return self.figures.coverage

    @property
    def act_only_precision(self) -> float:
        """Share of acting steps whose verb is right; NaN without any."""
        precision = self.figures.act_only_precision
        return float("nan") if precision is None else precision

    @property
    def false_assists(self) -> int:
        """Episodes of ACT that begin wrong."""
        return self.figures.false_assists


def estimates(logits: NDArray[np.float64], calibration: Calibration, mask: int) -> list[IntentEstimate | None]:
    """What the predictor would have said at each step (None where logits are NaN)."""
    made: list[IntentEstimate | None] = []
    for index, row in enumerate(logits):
        if np.isnan(row[0]):
            made.append(None)
            continue
        probabilities, top, confidence = calibration.apply(row, mask)
        now_ns = index * STEP_NS
        made.append(
            IntentEstimate(now_ns, now_ns, tuple(probabilities.tolist()), top, confidence, 0, (True, True, True))
        )
    return made


def replay(config: GateConfig, beliefs: list[IntentEstimate | None], stream: Stream) -> Replay:
    """Drive `core.gate` over the stream. Right is what `Truth.is_right` calls right: preparing it or doing it."""
    state = GateState()
    count = len(stream)
    acting, verb = np.zeros(count, dtype=bool), np.full(count, -1)
    for index, belief in enumerate(beliefs):
        if index and stream.subject[index] != stream.subject[index - 1]:
            state = GateState()
        state, decision = step(config, state, belief, index * STEP_NS)
        if decision.action is Action.ACT and decision.verb_index is not None:
            acting[index], verb[index] = True, decision.verb_index
    intended = np.where(stream.event >= 0, stream.label, -1)
    return Replay(acting, verb, acting & ((verb == intended) | (verb == stream.current)))


def choose_threshold(
    beliefs: list[IntentEstimate | None], stream: Stream, target: float, band: float = 0.15, grid: int = 19
) -> tuple[float, Replay]:
    """The lowest tau_on of 0.05..0.95 whose replayed act-only precision reaches `target` there and above.

    Falls back to the highest tau that acts at all. Returns it with the replay at it.
    """
    best: tuple[float, Replay] | None = None
    for tau in np.linspace(0.05, 0.95, grid)[::-1]:
        tau_on = round(float(tau), 3)
        result = replay(GateConfig(tau_on=tau_on, tau_off=max(0.02, tau_on - band)), beliefs, stream)
        if not result.acting.any():
            continue
        if best is not None and not result.act_only_precision >= target:
            break
        best = (tau_on, result)
    if best is None:
        raise ValueError("the gate never acts on these streams, whatever the threshold: train longer")
    return best
