"""`python -m tests.tools.gate_people WORK`: what the gate claims and reaches on simulated people whom nothing was fitted on.

The benchmark's network, 90 people to calibrate on, 90 others to judge, 240 s each, every step of them; some ten minutes of
processor time to record, as many to train, kept in WORK.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from hilbridge.learning import metrics
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.data.synthetic import record_people
from hilbridge.learning.data.windows import onset_ends
from hilbridge.learning.experiments.benchmark import BENCHMARK_RECIPE, Plan, near_onset
from hilbridge.learning.training.gate_fit import GATE, TAU_BAND, Calibrated, calibrate
from hilbridge.learning.training.make_bundle import network_weights
from hilbridge.learning.training.replay import (
    Floats,
    mapped,
    replay,
    stream_logits,
    watch,
    window_masks,
    with_taus,
)
from hilbridge.learning.training.train import fit_network
from hilbridge.wearer.timeline import BENCHMARK, BENCHMARK_TRAINING, hiding

FIRST_SEED = 6_000
TAUS = (0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95)


def table(fitted: Calibrated, stream: Stream, logits: Floats) -> list[str]:
    """A line a threshold: precision with its interval by person, claimed confidence, coverage."""
    seen = watch(logits, window_masks(stream), stream.subject, fitted.temperatures, GATE)
    gate, able = replace(GATE, maps=fitted.maps), seen.able
    confidence = mapped(fitted.maps, seen.probability, seen.condition)[able]
    lines = [f"ECE15 at ticks {metrics.ece(confidence, stream.right(seen.candidate)[able]):.4f}"]
    for tau_on in TAUS:
        done = replay(with_taus(gate, tau_on, TAU_BAND), seen, stream)
        if not done.acting.any():
            lines.append(f"tau_on {tau_on:g}: never acts")
            continue
        right = done.right[done.acting].astype(float)
        low, high = metrics.bootstrap(partial(_mean, right), stream.subject[done.acting], 200)
        lines.append(
            f"tau_on {tau_on:g}: precision {right.mean():.3f} ({low:.3f} to {high:.3f}), claimed {done.mean_confidence:.3f}, "
            f"coverage {done.coverage:.3f}"
        )
    return lines


def _mean(values: Floats, index: np.ndarray) -> float:
    return float(values[index].mean())


def main(arguments: list[str]) -> int:
    """Train, record, calibrate, judge, print."""
    parser = argparse.ArgumentParser(prog="python -m tests.tools.gate_people", description=__doc__)
    parser.add_argument("work", type=Path)
    parser.add_argument("--people", type=int, default=90, help="to judge")
    parser.add_argument("--fit", type=int, nargs="+", default=[90, 30, 15], help="to calibrate on")
    parser.add_argument("--seconds", type=float, default=240.0)
    parser.add_argument(
        "--clarity", choices=["visible", "hidden"], default="visible", help="whether it shows how clear one is"
    )
    parser.add_argument("--training", type=int, default=160, help="people to train on")
    parser.add_argument("--training-seconds", type=float, default=900.0, help="of each, windows before onsets")
    parser.add_argument("--epochs", type=int, default=BENCHMARK_RECIPE.epochs)
    chosen = parser.parse_args(arguments)
    as_asked = hiding if chosen.clarity == "hidden" else lambda difficulty: difficulty
    judged_people = as_asked(BENCHMARK)
    seeds = Plan(training=chosen.training, seconds=chosen.training_seconds).seeds()
    training, validation = (
        record_people(seeds[part], as_asked(kind), chosen.training_seconds, chosen.work / "streams", whole_seconds=0.0)
        for part, kind in (("training", BENCHMARK_TRAINING), ("validation", BENCHMARK))
    )
    ends = near_onset(training), onset_ends(validation)
    recipe = replace(BENCHMARK_RECIPE, epochs=chosen.epochs)
    trained = fit_network(
        recipe, training, validation, chosen.work / f"network-{chosen.clarity}-{chosen.training}", ends
    )
    weights = network_weights(trained)
    most = max(chosen.fit)
    parts = range(FIRST_SEED, FIRST_SEED + most), range(FIRST_SEED + most, FIRST_SEED + most + chosen.people)
    fit, judged = (record_people(part, judged_people, chosen.seconds, chosen.work / "streams") for part in parts)
    fit_logits, logits = (stream_logits(weights, part, trained.statistics) for part in (fit, judged))
    for count in chosen.fit:
        some = fit.subject < FIRST_SEED + count
        lines = table(calibrate([fit_logits[some]], fit.part(some), ((),)), judged, logits)
        sys.stdout.write(
            "\n".join(
                [f"clarity {chosen.clarity}: {count} people to calibrate on, {chosen.people} to judge", *lines, ""]
            )
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
