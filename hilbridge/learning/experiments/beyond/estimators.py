"""Estimators of confidence judged by what they change: whom they rank first, when they act, and what acting is then worth.

After arXiv 2605.18045: an estimator is worth its cost only where decisions come out otherwise. All act on the same share of the
same windows, so that none looks better for acting less; what a threshold changes stands beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from hilbridge.confidence import ALL_VALID
from hilbridge.intent.calibration import softmax
from hilbridge.learning import metrics
from hilbridge.learning.calibrators import Method
from hilbridge.learning.experiments.tables import Fold, Pooled
from hilbridge.learning.training.fit import fit_temperature
from hilbridge.learning.training.gate_fit import fit_map

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]
Row = dict[str, Any]
COVERAGES = (0.5, 0.25)
MARGIN = 0.02  # of act-only precision: less is no difference
REFERENCE = "temperature"
TAUS = (0.4, 0.5, 0.6, 0.7)
DRAWS = 400
_TIE = 1e-6


@dataclass(frozen=True, slots=True)
class Estimator:
    """confidence (N,) as it says it, order (N,) the same without ties, right (N,) whether its own top verb is."""

    confidence: Floats
    order: Floats
    right: Flags


def estimators(pooled: Pooled, ensemble: Sequence[Fold] = ()) -> dict[str, Estimator]:
    """Softmax, temperature, isotonic, the gate's map, MC dropout of the head, and an ensemble where members are there."""
    fine = pooled.confidence(Method.TEMPERATURE)
    right = pooled.right()

    def of_top(confidence: Floats) -> Estimator:
        return Estimator(confidence, confidence + _TIE * fine, right)

    def of_all(probabilities: Floats) -> Estimator:
        top = probabilities.max(axis=1)
        return Estimator(top, top, np.asarray(probabilities.argmax(axis=1) == pooled.labels))

    made = {
        "softmax": of_top(pooled.confidence(Method.NONE)),
        REFERENCE: of_top(fine),
        "isotonic": of_top(pooled.confidence(Method.ISOTONIC)),
        "the gate's map": of_top(_mapped(pooled)),
        "MC dropout of the head": of_all(_dropout(pooled.folds)),
    }
    if ensemble:
        made[f"ensemble of {len(ensemble) + 1}"] = of_all(_mean([pooled.folds[0], *ensemble]))
    return made


def estimator_rows(made: Mapping[str, Estimator], subject: Ints) -> list[Row]:
    """One row an estimator and coverage. Differences to temperature are paired by window, intervals drawn by subject."""
    rows = []
    usual = made[REFERENCE]
    for name, one in made.items():
        ranks = partial(_spearman, one.confidence, one.right)
        low, high = metrics.bootstrap(ranks, subject, DRAWS)
        for coverage in COVERAGES:
            difference = partial(_difference, one, usual, coverage)
            everybody = np.arange(len(subject))
            least, most = metrics.bootstrap(difference, subject, DRAWS, level=0.9)
            acts, acts_usually = _acts(one.order, coverage), _acts(usual.order, coverage)
            rows.append(
                {
                    "estimator": name,
                    "spearman": ranks(everybody),
                    "spearman_low": low,
                    "spearman_high": high,
                    "coverage": coverage,
                    "act_only_precision": metrics.precision_at_coverage(one.order, one.right, coverage),
                    "act_defer_agreement": float((acts == acts_usually).mean()),
                    "less_temperature": difference(everybody),
                    "less_temperature_low": least,
                    "less_temperature_high": most,
                    "equivalent": "yes" if least > -MARGIN and most < MARGIN else "not shown",
                }
            )
    return rows


def threshold_rows(made: Mapping[str, Estimator]) -> list[Row]:
    """The same estimators at thresholds instead: precision and coverage move together."""
    rows = []
    for name, one in made.items():
        for tau in TAUS:
            precision, coverage = metrics.act_only_precision(one.confidence, one.right, tau)
            rows.append({"estimator": name, "tau": tau, "coverage": coverage, "act_only_precision": precision})
    return rows


def what_changes_what(made: Mapping[str, Estimator]) -> str:
    """In words: how far the threshold moves precision, and how far the estimator does at matched coverage."""
    usual = made[REFERENCE]
    moved = [metrics.act_only_precision(usual.confidence, usual.right, tau) for tau in (TAUS[0], TAUS[-1])]
    (low, much), (high, little) = moved
    spread = []
    for coverage in COVERAGES:
        reached = [metrics.precision_at_coverage(one.order, one.right, coverage) for one in made.values()]
        spread.append(f"{max(reached) - min(reached):.3f} at coverage {coverage:g}")
    return (
        f"Moving the threshold from {TAUS[0]:g} to {TAUS[-1]:g} changes the act-only precision of {REFERENCE} by "
        f"{high - low:+.3f} (coverage {much:.3f} to {little:.3f}); choosing another estimator at matched "
        "coverage changes it by at most "
        f"{' and '.join(spread)}. "
    )


def _mapped(pooled: Pooled) -> Floats:
    """The gate's kind of map, here of windows: each fold's own calibration people, no smoothing."""
    made = []
    for fold, calibration in zip(pooled.folds, pooled.calibrations, strict=True):
        temperature = calibration.temperature(ALL_VALID)
        own = softmax(fold[f"calibration_logits_{ALL_VALID}"] / temperature)
        fitted = fit_map(own.max(axis=1), own.argmax(axis=1) == fold["calibration_label"])
        test = softmax(fold[f"test_logits_{ALL_VALID}"] / temperature).max(axis=1)
        made.append(np.interp(test, fitted.x, fitted.y))
    return np.concatenate(made)


def _dropout(folds: Sequence[Fold]) -> Floats:
    """With a temperature too: that is no privilege of the others."""
    made = []
    for fold in folds:
        temperature = fit_temperature(_log(fold["dropout_calibration"]), fold["calibration_label"])
        made.append(softmax(_log(fold["dropout_probabilities"]) / temperature))
    return np.concatenate(made)


def _mean(members: Sequence[Fold]) -> Floats:
    scaled = []
    for fold in members:
        temperature = fit_temperature(fold[f"calibration_logits_{ALL_VALID}"], fold["calibration_label"])
        scaled.append(softmax(fold[f"test_logits_{ALL_VALID}"] / temperature))
    return np.asarray(np.mean(scaled, axis=0))


def _log(probabilities: Floats) -> Floats:
    return np.log(np.maximum(np.asarray(probabilities, dtype=np.float64), 1e-12))


def _spearman(confidence: Floats, right: Flags, index: Ints) -> float:
    if np.ptp(confidence[index]) == 0.0 or np.ptp(right[index].astype(float)) == 0.0:
        return 0.0  # nothing is ranked
    return float(spearmanr(confidence[index], right[index]).statistic)


def _acts(order: Floats, coverage: float) -> Flags:
    acts = np.zeros(len(order), dtype=bool)
    acts[np.argsort(-order, kind="stable")[: max(1, round(coverage * len(order)))]] = True
    return acts


def _difference(one: Estimator, other: Estimator, coverage: float, index: Ints) -> float:
    """Of act-only precision at the same coverage of the same windows."""
    ours, theirs = (
        metrics.precision_at_coverage(each.order[index], each.right[index], coverage) for each in (one, other)
    )
    return ours - theirs
