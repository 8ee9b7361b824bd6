"""Does a certificate keep its promise? Simulated streams with repeated windows and subject shift, all methods at once.

`python -m hilbridge.learning.certificate.study --people 60 200 --trials 1000` prints the table at full size (MAPIE is in it
where it is installed; it comes with the extra `test`).
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress

from hilbridge.learning.certificate.certify import (
    AVERAGE_PERSON,
    ESTIMANDS,
    POOLED,
    TAUS,
    Method,
    certify,
    promising_start,
    window_counts,
)

Floats = NDArray[np.float64]
OTHERS = 90  # people who choose where a sequence begins, and are not tested
EVENTS = "clopper_pearson_events"  # the same bound on each event once, not on its copies


@dataclass(frozen=True, slots=True)
class World:
    """One kind of stream: `events` per person, each seen in `repeats` overlapping windows; people differ by a normal
    shift (sd `shift`) in the log odds of being right, and the confidence is too high by `overconfidence` log odds."""

    events: int = 20
    repeats: int = 25
    shift: float = 0.8
    overconfidence: float = 0.3
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Row:
    """One method on many simulated calibration sets; a violation is of its own estimand."""

    method: str
    estimand: str
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


def true_curves(world: World) -> tuple[dict[str, Floats], Floats]:
    """By estimand the precision, and the coverage, at every candidate tau in the whole population (a very large sample)."""
    single = World(world.events, 1, world.shift, world.overconfidence)
    confidence, right, person = draw(single, 40_000, np.random.default_rng([world.seed, 99]))
    counts = window_counts(confidence, right, person)
    acts = counts.acting > 0
    wrong = np.where(acts, counts.wrong / np.maximum(counts.acting, 1), 0.0)
    pooled = 1.0 - counts.wrong.sum(axis=1) / np.maximum(counts.acting.sum(axis=1), 1)
    average = 1.0 - wrong.sum(axis=1) / np.maximum(acts.sum(axis=1), 1)
    return {POOLED: pooled, AVERAGE_PERSON: average}, counts.acting.sum(axis=1) / len(confidence)


def study(
    people: int,
    trials: int,
    precision: float,
    delta: float,
    world: World | None = None,
    mapie: bool = False,
    progress: Callable[[], None] = lambda: None,
) -> list[Row]:
    """Violations and coverage lost against the oracle tau, per method, over `trials` simulated calibration sets."""
    world = world or World()
    truths, coverage = true_curves(world)
    estimands = {**{str(method): ESTIMANDS[method] for method in Method}, EVENTS: POOLED}
    estimands |= {"mapie": POOLED} if mapie else {}
    chosen: dict[str, list[int | None]] = {method: [] for method in estimands}
    for trial in range(trials):
        for name, tau in _chosen(world, people, trial, precision, delta).items():
            chosen[name].append(None if tau is None else TAUS.index(tau))
        if mapie:
            confidence, right, _ = draw(world, people, np.random.default_rng([world.seed, people, trial]))
            chosen["mapie"].append(_mapie(confidence, right, precision, delta))
        progress()
    rows = []
    for name, estimand in estimands.items():
        truth = truths[estimand]
        oracle = float(coverage[truth >= precision].max(initial=0.0))
        made = [row for row in chosen[name] if row is not None]
        violated = sum(bool(truth[row] < precision) for row in made)
        kept = [coverage[row] if row is not None else 0.0 for row in chosen[name]]
        lost = oracle - float(np.mean(kept))
        rows.append(Row(name, estimand, people, trials, violated / trials, len(made) / trials, lost))
    return rows


def _chosen(world: World, people: int, trial: int, precision: float, delta: float) -> dict[str, float | None]:
    """What each method certifies on one calibration set."""
    confidence, right, person = draw(world, people, np.random.default_rng([world.seed, people, trial]))
    counts = window_counts(confidence, right, person)
    once = slice(None, None, world.repeats)
    events = window_counts(confidence[once], right[once], person[once])
    others = window_counts(*draw(world, OTHERS, np.random.default_rng([world.seed, people, trial, 1])))
    made: dict[str, float | None] = {}
    for method in Method:
        start = (
            promising_start(others, precision, method) if method in (Method.BETTING, Method.BETTING_POOLED) else None
        )
        made[str(method)] = certify(counts, precision, delta, method, start).tau_on
    made[EVENTS] = certify(events, precision, delta, Method.CLOPPER_PEARSON).tau_on
    return made


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


def main(arguments: Sequence[str]) -> int:
    """The study as a table on standard output."""
    parser = argparse.ArgumentParser(prog="python -m hilbridge.learning.certificate.study", description=__doc__)
    parser.add_argument("--people", type=int, nargs="+", default=[30, 60, 200], help="people per calibration set")
    parser.add_argument("--trials", type=int, default=1_000, help="simulated calibration sets")
    parser.add_argument("--precision", type=float, default=0.8)
    parser.add_argument("--delta", type=float, default=0.1)
    chosen = parser.parse_args(arguments)
    if min(chosen.people) < 2 or chosen.trials < 1 or not 0 < chosen.precision < 1 or not 0 < chosen.delta < 1:
        parser.error("people must be at least 2, trials at least 1, precision and delta between 0 and 1")
    world = World()
    sys.stdout.write(
        f"{world.events} actions a person, each in {world.repeats} windows; subject shift {world.shift} log odds; "
        f"promise: P(precision < {chosen.precision}) <= {chosen.delta}; betting is about the {AVERAGE_PERSON}, all others "
        f"about the {POOLED}; {OTHERS} other people choose where a sequence begins\n"
        f"{'method':24}{'people':>8}{'trials':>8}{'violations':>12}{'certified':>11}{'coverage lost':>15}\n"
    )
    with_mapie = find_spec("mapie") is not None
    for people in chosen.people:
        with Progress(console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(f"{people} people", total=chosen.trials)
            rows = study(
                people,
                chosen.trials,
                chosen.precision,
                chosen.delta,
                mapie=with_mapie,
                progress=lambda bar=bar, task=task: bar.advance(task),  # type: ignore[misc]
            )
        for row in rows:
            sys.stdout.write(
                f"{row.method:24}{row.people:8d}{row.trials:8d}{row.violations:12.3f}{row.certified:11.3f}"
                f"{row.coverage_lost:15.3f}\n"
            )
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
