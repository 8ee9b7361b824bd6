"""Does a certificate keep its promise? Simulated streams with repeated windows and subject shift, all methods at once."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from importlib import import_module

import numpy as np
from numpy.typing import NDArray

from hilbridge.learning.certify import TAUS, Method, certify, window_counts

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class World:
    """One kind of stream: `events` per person, each seen in `repeats` overlapping windows; people differ by a normal
    shift (sd `shift`) in the log odds of being right, and the confidence is too high by `overconfidence` log odds."""

    events: int = 20
    repeats: int = 25
    shift: float = 0.8
    overconfidence: float = 0.3


@dataclass(frozen=True, slots=True)
class Row:
    """One method on many simulated calibration sets."""

    method: str
    people: int
    trials: int
    violations: float
    certified: float
    coverage_lost: float


def draw(world: World, people: int, rng: np.random.Generator) -> tuple[Floats, NDArray[np.bool_], NDArray[np.int64]]:
    """Confidence, right and person of every window."""
    size = (people, world.events)
    confidence = rng.beta(1.2, 0.9, size=size)
    log_odds = np.log(confidence / (1.0 - confidence)) - world.overconfidence
    log_odds += rng.normal(0.0, world.shift, size=(people, 1))
    right = rng.uniform(size=size) < 1.0 / (1.0 + np.exp(-log_odds))
    person = np.repeat(np.arange(people), world.events * world.repeats)
    return np.repeat(confidence.ravel(), world.repeats), np.repeat(right.ravel(), world.repeats), person


def true_curve(world: World, seed: int = 0) -> tuple[Floats, Floats]:
    """Act-only precision and coverage at every candidate tau in the whole population (a very large sample)."""
    single = World(world.events, 1, world.shift, world.overconfidence)
    confidence, right, _ = draw(single, 40_000, np.random.default_rng([seed, 99]))
    acting = np.array([(confidence >= tau).sum() for tau in TAUS])
    hits = np.array([(right & (confidence >= tau)).sum() for tau in TAUS])
    return hits / np.maximum(acting, 1), acting / len(confidence)


def study(
    people: int,
    trials: int,
    precision: float,
    delta: float,
    world: World | None = None,
    mapie: bool = False,
    seed: int = 0,
) -> list[Row]:
    """Violations and coverage lost against the oracle tau, per method, over `trials` simulated calibration sets."""
    world = world or World()
    truth, coverage = true_curve(world, seed)
    oracle = float(coverage[truth >= precision].max(initial=0.0))
    methods = [*map(str, Method), *(["mapie"] if mapie else [])]
    chosen: dict[str, list[int | None]] = {method: [] for method in methods}
    for trial in range(trials):
        confidence, right, person = draw(world, people, np.random.default_rng([seed, people, trial]))
        counts = window_counts(confidence, right, person)
        for method in Method:
            tau = certify(counts, precision, delta, method).tau_on
            chosen[str(method)].append(None if tau is None else TAUS.index(tau))
        if mapie:
            chosen["mapie"].append(_mapie(confidence, right, precision, delta))
    rows = []
    for name in methods:
        made = [row for row in chosen[name] if row is not None]
        violated = sum(bool(truth[row] < precision) for row in made)
        kept = [coverage[row] if row is not None else 0.0 for row in chosen[name]]
        rows.append(Row(name, people, trials, violated / trials, len(made) / trials, oracle - float(np.mean(kept))))
    return rows


def _mapie(confidence: Floats, right: NDArray[np.bool_], precision: float, delta: float) -> int | None:
    """MAPIE's precision control on the same windows, as its documentation shows it (it takes windows as independent)."""
    controllers = import_module("mapie.risk_control")  # a test-only package, not among the requirements

    def predict_proba(x: Floats) -> Floats:
        return np.column_stack([1.0 - x[:, 0], x[:, 0]])

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        controller = controllers.BinaryClassificationController(
            predict_proba,
            "precision",
            target_level=precision,
            confidence_level=1.0 - delta,
            list_predict_params=np.array(sorted(TAUS)),
        )
        controller.calibrate(confidence[:, None], right.astype(int))
    best = controller.best_predict_param
    return None if best is None else TAUS.index(round(float(best), 2))
