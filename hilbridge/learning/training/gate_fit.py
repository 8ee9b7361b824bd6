"""Calibrates what the gate compares: the candidate's smoothed probability, at every tick at which the gate could act.

One rising map for each condition (`hilbridge.confidence`). Calibrating windows before onsets instead, and smoothing
afterwards, promises what the loop does not keep: just after a new intention forms the old belief lingers in window and average.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.isotonic import IsotonicRegression
from sklearn.linear_model import LogisticRegression

from hilbridge.confidence import ALL_VALID, MASKS, TREMOR_SHIFT, ConfidenceMaps, RisingMap
from hilbridge.core.gate import GateConfig
from hilbridge.intent.bundle import Replayed
from hilbridge.intent.gru import Weights
from hilbridge.intent.online import BLOCK_TICKS, Usual
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.data.windows import Statistics
from hilbridge.learning.training.fit import fit_temperature
from hilbridge.learning.training.replay import (
    Replay,
    Watched,
    conditions,
    mapped,
    replay,
    stream_logits,
    watch,
    with_taus,
)
from hilbridge.records import Modality
from hilbridge.verbs import DEFAULT, Vocabulary

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
CAP = 0.99
MOST_GROUPS = 60
LEAST_PER_GROUP = 150  # ticks: neighbours say nearly the same, so these are a few independent ones
LEAST_TICKS = 1500  # a minute of a level of tremor; with less it counts as never measured, and is never acted on
# A point of the curve on less coverage, or on fewer than a quarter of the people, is noise.
LEAST_COVERAGE = 0.02
LEAST_PEOPLE = 5
PSEUDO_TICKS = 200.0  # that believe the logistic curve
TEMPERATURE_EVERY = 12  # steps: windows between hardly differ
TAU_BAND = 0.05  # tau_on - tau_off, in confidence: wider, and what is kept acting on is well below what tau_on promises
GATE = GateConfig(tau_on=0.5, tau_off=0.5 - TAU_BAND)
LOSSES: tuple[tuple[Modality, ...], ...] = tuple(lost for size in range(3) for lost in combinations(Modality, size))
TAUS = tuple(round(0.05 + 0.025 * step, 3) for step in range(37))


def fit_map(probability: Floats, right: Flags) -> RisingMap:
    """The chance of being right for each smoothed probability, rising, at most 0.99.

    Ticks are pooled into groups, and each is pulled towards a logistic curve through all of them: the highest group of a few
    people is a few lucky actions.
    """
    order = np.argsort(probability, kind="stable")
    if len(order) == 0:
        return RisingMap((0.0, 1.0), (0.0, 0.0))
    groups = np.array_split(order, int(np.clip(len(order) // LEAST_PER_GROUP, 1, MOST_GROUPS)))
    x = np.array([probability[group].mean() for group in groups])
    hits = np.array([right[group].sum() for group in groups], dtype=float)
    count = np.array([len(group) for group in groups], dtype=float)
    y = (hits + PSEUDO_TICKS * _logistic(x, hits, count)) / (count + PSEUDO_TICKS)
    rising = IsotonicRegression(y_min=0.0, y_max=CAP).fit_transform(x, y, sample_weight=count)
    # Straight down to nothing below the lowest group, flat above the highest: nobody knows what lies beyond.
    xs = (0.0, *(float(number) for number in np.clip(np.maximum.accumulate(x), 0.0, 1.0)), 1.0)
    return RisingMap(xs, (0.0, *(float(number) for number in rising), float(rising[-1])))


def _logistic(x: Floats, hits: Floats, count: Floats) -> Floats:
    """What a logistic curve on the log odds of the smoothed probability says of each group: two numbers for all of them."""
    odds = np.log(np.clip(x, 1e-4, 1.0 - 1e-4) / np.clip(1.0 - x, 1e-4, 1.0))[:, None]
    if not 0.0 < hits.sum() < count.sum():
        return np.full(len(x), hits.sum() / count.sum())
    both = np.concatenate([np.ones(len(x)), np.zeros(len(x))])
    model = LogisticRegression().fit(np.concatenate([odds, odds]), both, np.concatenate([hits, count - hits]))
    return np.asarray(model.predict_proba(odds)[:, 1])


def fit_maps(parts: Iterable[tuple[Watched, Stream]]) -> ConfidenceMaps:
    """A map for each condition that occurs, from streams watched under each."""
    conditions, probabilities, rights = [], [], []
    for seen, stream in parts:
        used = seen.able & stream.known
        conditions.append(seen.condition[used])
        probabilities.append(seen.probability[used])
        rights.append(stream.right(seen.candidate)[used])
    condition, probability, right = (np.concatenate(made) for made in (conditions, probabilities, rights))
    made = {}
    for one in np.unique(condition):
        here = condition == one
        enough = not one >> TREMOR_SHIFT or here.sum() >= LEAST_TICKS
        if one & ALL_VALID and enough:  # a window that mostly had nothing has no map
            made[int(one)] = fit_map(probability[here], right[here])
    return ConfidenceMaps(made)


class Turn(NamedTuple):
    """Some people, and the gate with maps that were fitted on the others."""

    gate: GateConfig
    seen: Watched
    stream: Stream


@dataclass(frozen=True, slots=True)
class Calibrated:
    """What a bundle needs beside its network: `curve` is of people whose maps were fitted on the others."""

    temperatures: Mapping[int, float]
    maps: ConfidenceMaps
    curve: tuple[Replayed, ...]
    turns: tuple[Turn, ...]

    @property
    def usual(self) -> Usual | None:
        """Bounds of people's mean confidence; None of too few people who were seen for long enough."""
        condition = int(np.bincount(np.concatenate([turn.seen.condition for turn in self.turns])).argmax())
        means = [mean for turn in self.turns for mean in _mean_confidences(turn, condition)]
        if len(means) < LEAST_PEOPLE or not condition:
            return None
        spread = float(np.std(means))
        return Usual(max(0.0, min(means) - spread), min(1.0, max(means) + spread), condition)


def _mean_confidences(turn: Turn, condition: int) -> list[float]:
    """Of each person with a block or more at which the gate looked, as the running bridge does (`online.ConfidenceDrift`)."""
    seen = turn.seen
    looked = ~seen.vetoed & (seen.candidate >= 0) & (seen.condition == condition)
    confidence = mapped(turn.gate.maps, seen.probability, seen.condition)
    own = (confidence[looked & (turn.stream.subject == person)] for person in np.unique(turn.stream.subject))
    return [float(one.mean()) for one in own if len(one) >= BLOCK_TICKS]


def logits_by_loss(
    weights: Weights, statistics: Statistics, stream: Stream, losses: Sequence[tuple[Modality, ...]] = LOSSES
) -> list[Floats]:
    """(N, K) logits of people that the network was not trained on, for each loss of modalities."""
    return [stream_logits(weights, stream, statistics, lost) for lost in losses]


def calibrate(
    logits: Sequence[Floats],
    stream: Stream,
    losses: Sequence[tuple[Modality, ...]] = LOSSES,
    vocabulary: Vocabulary = DEFAULT,
) -> Calibrated:
    """Temperatures, maps and the replayed curve, from `logits_by_loss`. Raises ValueError where the gate never acts."""
    gate = replace(GATE, vocabulary=vocabulary)
    under = [conditions(stream, lost) for lost in losses]
    temperatures = _temperatures(logits, [own & ALL_VALID for own in under], stream)
    parts = [
        (watch(own, condition, stream.subject, temperatures, gate), stream)
        for own, condition in zip(logits, under, strict=True)
    ]
    maps = fit_maps(parts)
    turns = cross_fitted(gate, parts)
    curve = replayed_curve(turns)
    if not curve:
        raise ValueError(
            "the gate never acts on these streams, whatever the threshold: train longer, or on more people"
        )
    # What was never seen is never acted on.
    nothing = {mask: RisingMap((0.0, 1.0), (0.0, 0.0)) for mask in MASKS if mask not in maps.by_condition}
    return Calibrated(temperatures, ConfidenceMaps({**nothing, **maps.by_condition}), curve, tuple(turns))


def _temperatures(logits: Sequence[Floats], masks: Sequence[NDArray[np.int64]], stream: Stream) -> dict[int, float]:
    """One for each mask, from the steps at which the wearer is busy; that of all modalities where a mask never occurs."""
    busy = stream.known & (stream.event >= 0)
    made: dict[int, float] = {}
    for mask in MASKS:
        rows, labels = [], []
        for own, masks_of_own in zip(logits, masks, strict=True):
            here = np.flatnonzero(busy & (masks_of_own == mask) & ~np.isnan(own[:, 0]))[::TEMPERATURE_EVERY]
            rows.append(own[here])
            labels.append(stream.label[here])
        values, wanted = np.concatenate(rows), np.concatenate(labels)
        if len(wanted):
            made[mask] = fit_temperature(values, wanted)
    usual = made.get(ALL_VALID, next(iter(made.values()), 1.0))
    return {mask: made.get(mask, usual) for mask in MASKS}


def cross_fitted(gate: GateConfig, parts: Sequence[tuple[Watched, Stream]], folds: int = 5) -> list[Turn]:
    """Everybody once. parts: the first is what will be replayed, all are fitted on; each holds the same people."""
    people = np.unique(parts[0][1].subject)
    groups = [people[start::folds] for start in range(min(folds, len(people)))]
    turns = []
    for group in groups:
        fitted = fit_maps(_people(parts, group, inside=False)) if len(groups) > 1 else fit_maps(parts)
        turns.append(Turn(replace(gate, maps=fitted), *_people(parts[:1], group, inside=True)[0]))
    return turns


def replays(turns: Sequence[Turn], tau_on: float) -> list[Replay]:
    """The gate of each turn at one threshold."""
    return [replay(with_taus(turn.gate, tau_on, TAU_BAND), turn.seen, turn.stream) for turn in turns]


def replayed_curve(turns: Sequence[Turn]) -> tuple[Replayed, ...]:
    """The gate at each tau_on where it acts for long enough to say something, and for more than a person or two."""
    everybody = sum(len(np.unique(turn.stream.subject)) for turn in turns)
    known = sum(int(turn.stream.known.sum()) for turn in turns)
    made = []
    for tau_on in TAUS:
        done = replays(turns, tau_on)
        subject = np.concatenate([turn.stream.subject[one.judged] for one, turn in zip(done, turns, strict=True)])
        right = np.concatenate([one.right[one.judged] for one in done])
        names, place = np.unique(subject, return_inverse=True)
        if 0 < len(right) >= LEAST_COVERAGE * known and len(names) >= min(everybody, max(LEAST_PEOPLE, everybody // 4)):
            own = np.bincount(place, weights=right) / np.bincount(place)
            coverage = len(right) / max(1, known)
            made.append(
                Replayed(tau_on, float(right.mean()), coverage, len(names), float(own.mean()), float(own.std()))
            )
    return tuple(made)


def _people(
    parts: Sequence[tuple[Watched, Stream]], group: NDArray[np.int64], *, inside: bool
) -> list[tuple[Watched, Stream]]:
    chosen = []
    for seen, stream in parts:
        where = np.isin(stream.subject, group) == inside
        chosen.append((seen.part(where), stream.part(where)))
    return chosen
