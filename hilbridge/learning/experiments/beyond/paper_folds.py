"""The paper's recipe on the synthetic benchmark: three subject-disjoint folds of 24 / 4 / 4 people, mean and deviation.

As the paper has it, calibrators are fitted on the four people by whom training stops. The recipe that `train --data` uses
stands beside it on the same folds; each fold has a seed of its own.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hilbridge.confidence import ALL_VALID
from hilbridge.features.layout import LAYOUT_HASH, RATE_HZ
from hilbridge.learning import metrics
from hilbridge.learning.calibrators import Calibration, Method
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.data.synthetic import record_people
from hilbridge.learning.data.windows import onset_ends
from hilbridge.learning.experiments.benchmark import FoldShape
from hilbridge.learning.experiments.tables import PAPER, with_top_confidence
from hilbridge.learning.training.fit import fit_calibration
from hilbridge.learning.training.gate_fit import GATE, TAU_BAND
from hilbridge.learning.training.make_bundle import network_weights
from hilbridge.learning.training.recipes import Recipe
from hilbridge.learning.training.replay import replay, stream_logits, watch, with_taus
from hilbridge.learning.training.train import fit_network, predict_logits
from hilbridge.wearer.timeline import BENCHMARK

Floats = NDArray[np.float64]
Row = dict[str, Any]
FIRST_SEED = 7_000
FOLDS = 3
STREAM_S = 240.0  # of each test person, every step, for E5
E3 = ((0.5, 0.65), (0.25, 0.80))  # coverage, the paper's act-only precision
E5_TAU, E5_PAPER = 0.5, {"none": 0.62, "temperature": 0.80}


def folds_of(people: int, held: int) -> list[tuple[list[int], list[int], list[int]]]:
    """(train, stop and calibrate, test) seeds of each fold; nobody is tested twice."""
    order = [int(seed) for seed in np.random.default_rng(6).permutation(np.arange(FIRST_SEED, FIRST_SEED + people))]
    made = []
    for fold in range(FOLDS):
        turned = order[fold * held :] + order[: fold * held]
        made.append((turned[2 * held :], turned[held : 2 * held], turned[:held]))
    return made


def recordings(shape: FoldShape) -> list[tuple[int, float]]:
    """(seed, seconds of which every step is kept) of everybody."""
    tested = [(seed, STREAM_S) for _, _, test in folds_of(shape.people, shape.held) for seed in test]
    return [*tested, *((seed, 0.0) for seed in range(FIRST_SEED, FIRST_SEED + shape.people))]


def record_one(folder: Path, shape: FoldShape, seed: int, whole: float) -> None:
    """One person, kept for the folds."""
    record_people([seed], BENCHMARK, shape.seconds, folder / "streams", whole_seconds=whole)


def run_fold(folder: Path, shape: FoldShape, fold: int, recipe: Recipe) -> Path:
    """Train one fold and keep its logits before onsets, and those of every step of the test people, with what is true."""
    seconds, people, held = shape.seconds, shape.people, shape.held
    made_of = seconds, replace(recipe, seed=fold), people, held, BENCHMARK, LAYOUT_HASH
    path = folder / f"paper-{fold}.{hashlib.sha256(repr(made_of).encode()).hexdigest()[:10]}.npz"
    if path.is_file():
        return path
    parts = [
        record_people(seeds, BENCHMARK, seconds, folder / "streams", whole_seconds=whole)
        for seeds, whole in zip(folds_of(people, held)[fold], (0.0, 0.0, STREAM_S), strict=True)
    ]
    training, stopping, test = parts
    ends = onset_ends(training), onset_ends(stopping)
    trained = fit_network(replace(recipe, seed=fold), training, stopping, path.with_suffix(""), ends)
    kept: dict[str, NDArray[Any]] = {}
    for name, stream in (("stop", stopping), ("test", test)):
        own = onset_ends(stream)
        logits = predict_logits(trained.network, stream, own, trained.statistics) + trained.logit_offset
        kept |= {f"{name}_logits": logits, f"{name}_label": stream.label[own], f"{name}_subject": stream.subject[own]}
    whole = test.part(np.arange(len(test)) % round(seconds * RATE_HZ) < STREAM_S * RATE_HZ)
    kept |= {f"stream_{name}": getattr(whole, name) for name in Stream.__dataclass_fields__}
    kept["stream_logits"] = stream_logits(network_weights(trained), whole, trained.statistics)
    partial = path.with_suffix(".partial.npz")
    np.savez_compressed(partial, allow_pickle=False, **kept)
    partial.replace(path)
    return path


def beside_the_paper(
    paper: Sequence[Mapping[str, NDArray[Any]]], ours: Sequence[Mapping[str, NDArray[Any]]]
) -> list[Row]:
    """The paper's recipe, the one of `train --data` on the same folds, and what the paper says of another data set."""
    return [
        {**row, "best_mean": best["mean"], "best_deviation": best["deviation"]}
        for row, best in zip(paper_rows(paper), paper_rows(ours), strict=True)
    ]


def paper_rows(folds: Sequence[Mapping[str, NDArray[Any]]]) -> list[Row]:
    """Mean and standard deviation over folds beside the paper's Table 1 and its E3 and E5 figures."""
    rows: list[Row] = []
    fitted = [fit_calibration({ALL_VALID: (fold["stop_logits"], fold["stop_label"])}, Method.NONE) for fold in folds]
    for method in Method:
        each = [_table_1(fold, replace(own, method=method)) for fold, own in zip(folds, fitted, strict=True)]
        for name in each[0]:
            rows.append(_row("Table 1", f"{method}: {name}", [one[name] for one in each], PAPER[str(method)].get(name)))
    for coverage, paper in E3:
        reached = []
        for fold, own in zip(folds, fitted, strict=True):
            confidence = replace(own, method=Method.TEMPERATURE).confidence(fold["test_logits"], ALL_VALID)
            right = fold["test_logits"].argmax(axis=1) == fold["test_label"]
            reached.append(metrics.precision_at_coverage(confidence, right, coverage))
        rows.append(_row("E3", f"act-only precision at coverage {coverage:g}", reached, paper))
    for way, paper in E5_PAPER.items():
        done = [_closed_loop(fold, own, way) for fold, own in zip(folds, fitted, strict=True)]
        for name, reference in (("act-only precision", paper), ("coverage", None)):
            figures = [one[name] for one in done]
            rows.append(_row("E5", f"closed loop at tau {E5_TAU:g}, {way}: {name}", figures, reference))
    return rows


def _row(table: str, what: str, figures: Sequence[float], paper: float | None) -> Row:
    own = np.array(figures, dtype=float)
    spread = float(own.std(ddof=1)) if len(own) > 1 else None
    return {
        "of": table,
        "what": what,
        "mean": float(own.mean()),
        "deviation": spread,
        "folds": len(own),
        "paper": paper,
    }


def _table_1(fold: Mapping[str, NDArray[Any]], calibration: Calibration) -> dict[str, float]:
    logits, labels = fold["test_logits"], fold["test_label"]
    confidence = calibration.confidence(logits, ALL_VALID)
    probabilities = calibration.probabilities(logits, ALL_VALID)
    right = logits.argmax(axis=1) == labels
    made = {"top1": float(right.mean()), "ece15": metrics.ece(confidence, right)}
    if calibration.method is Method.NONE:
        made["top5"] = metrics.top_k(logits, labels, 5)
    if calibration.method is Method.ISOTONIC:  # of the top class alone: the paper gives neither
        return made
    if calibration.method is Method.PLATT:
        probabilities = with_top_confidence(probabilities, confidence)
    return {**made, "nll": metrics.nll(probabilities, labels), "brier": metrics.brier(probabilities, labels)}


def _closed_loop(fold: Mapping[str, NDArray[Any]], calibration: Calibration, method: str) -> dict[str, float]:
    """Every step of the test people, as the paper's gate: temperature or none, smoothing, top 3, no map."""
    from hilbridge.learning.experiments.closed_loop import AT_ITS_WORD

    stream = Stream(**{name: fold[f"stream_{name}"] for name in Stream.__dataclass_fields__})
    temperature = 1.0 if method == "none" else calibration.temperature(ALL_VALID)
    everything = np.full(len(stream), ALL_VALID)
    seen = watch(fold["stream_logits"], everything, stream.subject, {ALL_VALID: temperature}, GATE)
    done = replay(with_taus(replace(GATE, maps=AT_ITS_WORD), E5_TAU, TAU_BAND), seen, stream)
    return {"act-only precision": done.act_only_precision, "coverage": done.coverage}


def load_fold(path: Path) -> Mapping[str, NDArray[Any]]:
    """What `run_fold` kept."""
    with np.load(path) as stored:
        return {name: stored[name] for name in stored.files}
