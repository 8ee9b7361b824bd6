"""What the simulated person does and when: one seeded timeline of verbs that everything else follows.

Transitions, durations and gaps follow aggregates of the real annotations (statistics.json). Every action is prepared
before its onset; what the preparation *shows* is the true verb with a chance that is the action's clarity, and
otherwise a verb drawn from the prior. With prior pi, shown verb s and clarity a the Bayes posterior is therefore
exactly `a * [k = s] + (1 - a) * pi_k`: the difficulty is set by construction.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from hilbridge.limits import MS

MIN_INTERVAL_MS = 2_200  # between onsets: so that every preparation reaches into the window that ends 0.5 s before
MIN_DURATION_MS = 800
MAX_DURATION_MS = 12_000
MAX_GAP_MS = 8_000
LEAD_MS = (1_500, 2_500)


@dataclass(frozen=True, slots=True)
class Statistics:
    """Aggregates of the annotations: (K, K) transition and (K,) start probabilities, (K, Q) quantiles in ms at `at`."""

    transitions: NDArray[np.float64]
    start: NDArray[np.float64]
    prior: NDArray[np.float64]
    at: NDArray[np.float64]
    duration_ms: NDArray[np.float64]
    gap_ms: NDArray[np.float64]


@cache
def statistics() -> Statistics:
    """The committed aggregates; `prior` is the stationary distribution of the transitions."""
    raw = json.loads((files("hilbridge.wearer") / "statistics.json").read_text(encoding="utf-8"))
    # Half a count everywhere: a transition never seen in 86 sessions is rare, not impossible.
    counts = np.array(raw["transitions"], dtype=float) + 0.05
    transitions = counts / counts.sum(axis=1, keepdims=True)
    first = np.array(raw["first"], dtype=float) + 0.05
    prior = np.full(len(first), 1.0 / len(first))
    for _ in range(500):
        prior = prior @ transitions
    return Statistics(
        transitions,
        first / first.sum(),
        prior / prior.sum(),
        np.array(raw["quantiles"]),
        np.array(raw["duration_ms"], dtype=float),
        np.array(raw["gap_ms"], dtype=float),
    )


@dataclass(frozen=True, slots=True)
class Difficulty:
    """How clear preparations are: a mixture of uniform clarities, rows (weight, low, high).

    interaction: True shows the frequent verbs so that colour and hand pattern only mean something together. hidden: how far
    hands reach and the head leans in says nothing of the clarity; else the clearer an intention is, the plainer it shows, and a
    predictor reads its own confidence off the picture.
    """

    name: str
    mixture: tuple[tuple[float, float, float], ...]
    interaction: bool
    hidden: bool = False

    @property
    def mean(self) -> float:
        """Of the clarities."""
        total = sum(weight for weight, _, _ in self.mixture)
        return sum(weight * (low + high) / 2.0 for weight, low, high in self.mixture) / total

    def draw(self, rng: np.random.Generator) -> float:
        """One action's clarity, 0..1."""
        weights = np.array([row[0] for row in self.mixture])
        _, low, high = self.mixture[int(rng.choice(len(weights), p=weights / weights.sum()))]
        return float(rng.uniform(low, high))


# BENCHMARK resembles the paper's figures: Bayes Top-1 about 0.40, act-only precision 0.60 at coverage 0.5 and 0.85 at
# 0.25. DEMO is an easier person, so that half a minute shows both ACT and HOLD.
BENCHMARK = Difficulty("benchmark", ((0.25, 0.68, 0.97), (0.25, 0.10, 0.45), (0.50, 0.0, 0.06)), interaction=True)
# Clarity does not change what a preparation means (the posterior above does not depend on how clarities are spread), so
# people who prepare more clearly teach the same thing with fewer examples.
BENCHMARK_TRAINING = Difficulty(
    "benchmark-training", ((0.60, 0.75, 0.97), (0.20, 0.10, 0.50), (0.20, 0.0, 0.06)), interaction=True
)
DEMO = Difficulty("demo", ((0.7, 0.92, 0.99), (0.3, 0.0, 0.35)), interaction=False)


def hiding(difficulty: Difficulty) -> Difficulty:
    """The same people, whose clarity nobody can see."""
    return replace(difficulty, name=f"{difficulty.name}-hidden", hidden=True)


@dataclass(frozen=True, slots=True)
class Event:
    """One action: prepared from `prepare_ns`, under way from `start_ns` to `end_ns`.

    `verb` is what the person does, `shown` what the preparation looks like, `clarity` the chance that they agree by
    design, `strength` how plainly it shows, 0..1, `cell` the (colour, hand pattern) that shows it.
    """

    index: int
    verb: int
    shown: int
    clarity: float
    strength: float
    cell: tuple[int, int]
    prepare_ns: int
    start_ns: int
    end_ns: int


COLOURS = 6
PATTERNS = 6


@cache
def cells(interaction: bool) -> tuple[tuple[tuple[int, int], ...], ...]:
    """Which (colour, hand pattern) cells show each verb.

    Without interaction every verb has one cell, which is easy to learn. With it, the three most frequent verbs (half of
    all actions) share a 3 x 3 square of cells like a Latin square: each shows with every colour and every pattern of it,
    so that either alone says nothing and only both together do (the paper's E2: losing either modality collapses
    accuracy). The other eighteen verbs have one cell each outside of that square.
    """
    if not interaction:
        return tuple(
            ((verb % COLOURS, (verb // COLOURS + verb) % PATTERNS),) for verb in range(len(statistics().prior))
        )
    latin = [tuple((colour, (colour + verb) % 3) for colour in range(3)) for verb in range(3)]
    outside = [
        (colour, (colour + turn) % PATTERNS)
        for turn in range(PATTERNS)
        for colour in range(COLOURS)
        if colour >= 3 or (colour + turn) % PATTERNS >= 3
    ]
    return (*latin, *((cell,) for cell in outside[: len(statistics().prior) - 3]))


class Timeline:
    """The events of one seed, made as far ahead as asked for; the same seed gives the same events always."""

    def __init__(self, seed: int, difficulty: Difficulty) -> None:
        self._rng = np.random.default_rng([seed, 1])
        self._strength = np.random.default_rng([seed, 7])  # of its own: hiding changes nothing else of a person
        self._difficulty = difficulty
        self._events: list[Event] = []

    def until(self, t_ns: int) -> list[Event]:
        """Events up to the first that starts after `t_ns` and one more."""
        while len(self._events) < 2 or self._events[-2].start_ns <= t_ns:
            self._events.append(self._next())
        return self._events

    def _next(self) -> Event:
        table = statistics()
        rng = self._rng
        before = self._events[-1] if self._events else None
        weights = table.start if before is None else table.transitions[before.verb]
        verb = int(rng.choice(len(weights), p=weights))
        start_ms = 3_000.0
        earliest_ms = 500.0
        if before is not None:
            gap_ms = float(np.interp(rng.uniform(), table.at, table.gap_ms[before.verb]))
            start_ms = max(before.end_ns / MS + min(gap_ms, MAX_GAP_MS), before.start_ns / MS + MIN_INTERVAL_MS)
            earliest_ms = before.start_ns / MS + 0.35 * (start_ms - before.start_ns / MS)
        duration_ms = float(np.interp(rng.uniform(), table.at, table.duration_ms[verb]))
        duration_ms = min(max(duration_ms, MIN_DURATION_MS), MAX_DURATION_MS)
        prepare_ms = max(start_ms - rng.uniform(*LEAD_MS), earliest_ms)
        clarity = self._difficulty.draw(rng)
        shown = verb if rng.uniform() < clarity else int(rng.choice(len(table.prior), p=table.prior))
        options = cells(self._difficulty.interaction)[shown]
        cell = options[int(rng.integers(len(options)))]
        return Event(
            len(self._events),
            verb,
            shown,
            clarity,
            self._difficulty.draw(self._strength) if self._difficulty.hidden else clarity,
            cell,
            round(prepare_ms * MS),
            round(start_ms * MS),
            round((start_ms + duration_ms) * MS),
        )


def bayes_posterior(shown: int, clarity: float, prior: NDArray[np.float64]) -> NDArray[np.float64]:
    """P(verb | shown, clarity) when the verb before is not known: (K,) summing to 1."""
    posterior = (1.0 - clarity) * prior
    posterior[shown] += clarity
    return posterior
