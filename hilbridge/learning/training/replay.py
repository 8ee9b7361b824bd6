"""Streams through the numpy engine and the gate, offline: calibration, thresholds, certificates and E5 stand on it.

The gate's own code takes one tick at a time; here all that does not depend on a threshold is done once for a whole stream
(`watch`), and a threshold costs one pass over plain numbers (`replay`). A property test holds it to `core.gate`, tick by tick.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from hilbridge.confidence import ALL_VALID, TREMOR_SHIFT, ConfidenceMaps
from hilbridge.core.gate import GateConfig
from hilbridge.core.gate_figures import GateFigures, GateTick, gate_figures
from hilbridge.features.layout import STEP_NS, drop_modality
from hilbridge.intent.calibration import softmax
from hilbridge.intent.gru import StreamingGru, Weights
from hilbridge.intent.standardise import standardise
from hilbridge.intent.tremor import TremorGuard
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.data.windows import STEPS, Statistics
from hilbridge.limits import EARN_NS
from hilbridge.records import FeatureVector, Modality

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]
EARN_STEPS = EARN_NS // STEP_NS


def stream_logits(
    weights: Weights, stream: Stream, statistics: Statistics, lost: tuple[Modality, ...] = ()
) -> NDArray[np.float64]:
    """Logits (N, K) of the window that ends at each step; NaN where no whole window of one person ends."""
    values, valid = without(stream, lost)
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
        if out is not None and 2 * engine.usable_steps() >= STEPS:
            logits[index] = out
    return logits


def without(stream: Stream, lost: tuple[Modality, ...]) -> tuple[NDArray[np.float32], Flags]:
    """A stream's features and masks with modalities taken away."""
    if not lost:
        return stream.values, stream.valid
    values, valid = stream.values.copy(), stream.valid.copy()
    for modality in lost:
        drop_modality(values, valid, modality)
    return values, valid


def window_masks(stream: Stream, lost: tuple[Modality, ...] = ()) -> Ints:
    """(N,) the mask of the window that ends at each step, as `Predictor.mask` has it."""
    _, valid = without(stream, lost)
    starts = np.flatnonzero(np.r_[True, stream.subject[1:] != stream.subject[:-1]])
    first = np.repeat(starts, np.diff(np.r_[starts, len(stream)]))
    index = np.arange(len(stream))
    low = np.maximum(first, index - STEPS + 1)
    sums = np.concatenate([np.zeros((1, 3), dtype=np.int64), np.cumsum(valid, axis=0)])
    counts = sums[index + 1] - sums[low]
    return np.asarray(((2 * counts >= (index + 1 - low)[:, None]) << np.arange(3)).sum(axis=1))


def conditions(stream: Stream, lost: tuple[Modality, ...] = ()) -> Ints:
    """(N,) the condition of each step: its window's mask and the level of tremor that the guard sees."""
    return window_masks(stream, lost) | tremor_levels(stream, lost) << TREMOR_SHIFT


def tremor_levels(stream: Stream, lost: tuple[Modality, ...] = ()) -> Ints:
    """(N,) what the running bridge's guard says at each step."""
    values, valid = without(stream, lost)
    levels = np.zeros(len(stream), dtype=np.int64)
    guard = TremorGuard()
    flags = [(bool(gaze), bool(hands), bool(scene)) for gaze, hands, scene in valid]
    for index, seen in enumerate(flags):
        if index and stream.subject[index] != stream.subject[index - 1]:
            guard.reset()
        levels[index] = guard.update(FeatureVector(0, 0, values[index], seen))
    return levels


@dataclass(frozen=True, slots=True)
class Watched:
    """What the gate sees of a stream, whatever its threshold.

    smoothed (N, K), NaN without belief; candidate (N,) its top verb, -1 without belief; able (N,) whether the gate could act
    on it, were it sure enough; vetoed (N,) whether nothing may act whatever was before; condition (N,) whose map holds.
    """

    smoothed: Floats
    candidate: Ints
    able: Flags
    vetoed: Flags
    condition: Ints

    @property
    def probability(self) -> Floats:
        """(N,) smoothed probability of the candidate; NaN without belief."""
        return np.asarray(self.smoothed[np.arange(len(self.candidate)), np.maximum(self.candidate, 0)])

    def part(self, where: Flags) -> Watched:
        """The steps of some people."""
        return Watched(*(getattr(self, field.name)[where] for field in fields(Watched)))


def watch(
    logits: Floats,
    condition: Ints,
    subject: Ints,
    temperatures: Mapping[int, float],
    config: GateConfig,
    veto: Flags | None = None,
) -> Watched:
    """Smooth as the gate does. veto (N,): further steps at which it holds, say of a tremor guard."""
    believed = ~np.isnan(logits[:, 0])
    scale = np.array([temperatures.get(mask, 1.0) for mask in range(ALL_VALID + 1)])[condition & ALL_VALID]
    newest = softmax(logits / scale[:, None])
    smoothed = np.full_like(newest, np.nan)
    vetoed = np.ones(len(logits), dtype=bool)
    begins = np.r_[True, (subject[1:] != subject[:-1]) | (believed[1:] != believed[:-1])]
    edges = np.r_[np.flatnonzero(begins), len(logits)]
    for start, stop in pairwise(edges.tolist()):
        if believed[start]:
            part = newest[start:stop]
            before = (1.0 - config.alpha) * part[:1]
            smoothed[start:stop] = lfilter([config.alpha], [1.0, config.alpha - 1.0], part, axis=0, zi=before)[0]
            vetoed[start + EARN_STEPS : stop] = False
    candidate = np.where(believed, np.argmax(np.where(believed[:, None], smoothed, 0.0), axis=1), -1)
    own = newest[np.arange(len(newest)), candidate]
    rank = (newest > own[:, None]).sum(axis=1)
    if veto is not None:
        vetoed |= veto
    able = ~vetoed & (rank < config.top_k) & ~np.isin(candidate, list(config.vocabulary.never_assisted))
    return Watched(smoothed, candidate, able, vetoed, condition)


@dataclass(frozen=True, slots=True)
class Replay:
    """What the gate did, per step: acting (N,), the verb acted on (N,) or -1 under HOLD, right (N,) as the truth judges,
    confidence (N,) reported under ACT, known (N,) whether there is a truth."""

    acting: Flags
    verb: Ints
    right: Flags
    confidence: Floats
    known: Flags

    @property
    def figures(self) -> GateFigures:
        """Counts over all steps, by the one definition."""
        steps = zip(self.verb.tolist(), self.right.tolist(), self.known.tolist(), strict=True)
        return gate_figures(
            GateTick(verb, right if known else None) if verb >= 0 else GateTick(None, None)
            for verb, right, known in steps
        )

    @property
    def judged(self) -> Flags:
        """(N,) acting steps whose truth is known."""
        return self.acting & self.known

    @property
    def coverage(self) -> float:
        """Share of known steps in ACT."""
        return float(self.judged.sum() / max(1, self.known.sum()))

    @property
    def act_only_precision(self) -> float:
        """Share of judged steps whose verb is right; NaN without any."""
        return float(self.right[self.judged].mean()) if self.judged.any() else float("nan")

    @property
    def mean_confidence(self) -> float:
        """Mean confidence reported at judged steps; NaN without any."""
        return float(self.confidence[self.judged].mean()) if self.judged.any() else float("nan")

    @property
    def false_assists(self) -> int:
        """Episodes of ACT that begin wrong."""
        return self.figures.false_assists


def mapped(maps: ConfidenceMaps, probability: Floats, condition: Ints) -> Floats:
    """`ConfidenceMaps.confidence` over arrays; NaN becomes 0."""
    made = np.zeros(len(probability))
    for one in np.unique(condition):
        here = condition == one
        fitted = maps.by_condition.get(int(one))
        if fitted is not None:
            made[here] = np.interp(probability[here], fitted.x, fitted.y)
    return np.nan_to_num(made)


def replay(config: GateConfig, seen: Watched, stream: Stream) -> Replay:
    """Drive the gate over a stream that was watched with the same `alpha` and `top_k`."""
    seen = _without_hopeless_tremor(config, seen)
    verb = _switched(config, seen, mapped(config.maps, seen.probability, seen.condition), stream.subject)
    acting = verb >= 0
    assisted = seen.smoothed[np.arange(len(verb)), np.maximum(verb, 0)]
    confidence = np.where(acting, mapped(config.maps, assisted, seen.condition), 0.0)
    return Replay(acting, verb, acting & stream.right(verb), confidence, stream.known)


def _without_hopeless_tremor(config: GateConfig, seen: Watched) -> Watched:
    """Tremor forbids ACT at once where no confidence could do, as in the running bridge."""
    trembling = [int(one) for one in np.unique(seen.condition) if one >> TREMOR_SHIFT]
    hopeless = [one for one in trembling if config.maps.highest(one) < config.tau_on]
    if not hopeless:
        return seen
    veto = np.isin(seen.condition, hopeless)
    return replace(seen, vetoed=seen.vetoed | veto, able=seen.able & ~veto)


def _switched(config: GateConfig, seen: Watched, confidence: Floats, subject: Ints) -> Ints:
    """(N,) the verb acted on, -1 under HOLD: the gate's switching, hysteresis and refractory time included."""
    rest = -(-config.refractory_ns // STEP_NS)
    free = seen.able.tolist()
    vetoed = seen.vetoed.tolist()
    sure, kept = (confidence >= config.tau_on).tolist(), (confidence >= config.tau_off).tolist()
    begins = np.r_[True, subject[1:] != subject[:-1]].tolist()
    verbs = np.full(len(confidence), -1)
    acting, switched = -1, -rest
    for index, candidate in enumerate(seen.candidate.tolist()):
        if begins[index]:
            acting, switched = -1, index - rest
        if vetoed[index]:
            if acting >= 0:
                acting, switched = -1, index
            continue
        resting = index - switched < rest
        if acting >= 0:
            if not resting and not (free[index] and candidate == acting and kept[index]):
                acting, switched = -1, index
        elif free[index] and sure[index] and not resting:
            acting, switched = candidate, index
        verbs[index] = acting
    return verbs


def with_taus(config: GateConfig, tau_on: float, band: float) -> GateConfig:
    """The gate with another threshold, and hysteresis of `band` below it."""
    return replace(config, tau_on=tau_on, tau_off=max(0.02, round(tau_on - band, 3)))
