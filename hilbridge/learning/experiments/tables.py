"""The tables of E1 to E5 from what the folds kept. Every figure is on people the network and its calibrators never saw."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hilbridge.confidence import ALL_VALID
from hilbridge.intent.calibration import softmax
from hilbridge.learning import metrics
from hilbridge.learning.calibrators import Calibration, Method
from hilbridge.learning.experiments.benchmark import LOSSES, mask_of
from hilbridge.learning.training.fit import fit_calibration, fit_temperature
from hilbridge.verbs import VERBS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Row = dict[str, Any]
Fold = Mapping[str, NDArray[Any]]
MC_PASSES = 10
REACHABLE = "taught by Bayes (the reachable part)"

# The paper's figures are of EGTEA Gaze+ with hand and scene features that are not at hand here: another data set.
PAPER: Mapping[str, Mapping[str, float]] = {
    "none": {"top1": 0.402, "ece15": 0.403, "nll": 2.73, "brier": 0.964},
    "temperature": {"top1": 0.402, "ece15": 0.071, "nll": 2.22, "brier": 0.785},
    "platt": {"top1": 0.404, "ece15": 0.085, "nll": 2.06, "brier": 0.753},
    "isotonic": {"top1": 0.399, "ece15": 0.039},
}


def load_folds(paths: Sequence[Path]) -> list[Fold]:
    """Everything the folds kept, in memory."""
    made: list[Fold] = []
    for path in paths:
        with np.load(path) as stored:
            made.append({name: stored[name] for name in stored.files})
    return made


class Pooled:
    """Test windows of all folds with calibrators fitted on each fold's own calibration people."""

    def __init__(self, folds: Sequence[Fold]) -> None:
        self.folds = folds
        self.labels: Ints = np.concatenate([fold["test_label"] for fold in folds])
        self.subject: Ints = np.concatenate([fold["test_subject"] for fold in folds])
        self.bayes: Floats = np.concatenate([fold["test_bayes"] for fold in folds]).astype(np.float64)
        self.calibrations = [self._fit(fold) for fold in folds]

    def _fit(self, fold: Fold) -> Calibration:
        labels = fold["calibration_label"]
        masks = {mask_of(lost): (fold[f"calibration_logits_{mask_of(lost)}"], labels) for lost in LOSSES}
        return fit_calibration(masks, Method.ISOTONIC)

    def logits(self, mask: int = ALL_VALID) -> Floats:
        """(N, K) test logits with the modalities of `mask`."""
        return np.concatenate([fold[f"test_logits_{mask}"] for fold in self.folds])

    def _each(self, method: Method, mask: int) -> Iterator[tuple[Calibration, Floats]]:
        """Each fold's calibrators, set to `method`, and test logits with the modalities of `mask`."""
        for fold, calibration in zip(self.folds, self.calibrations, strict=True):
            yield replace(calibration, method=method), fold[f"test_logits_{mask}"]

    def probabilities(self, method: Method, mask: int = ALL_VALID) -> Floats:
        """(N, K) after this set's temperature (none for Method.NONE)."""
        return np.concatenate([own.probabilities(logits, mask) for own, logits in self._each(method, mask)])

    def confidence(self, method: Method, mask: int = ALL_VALID, per_mask: bool = True) -> Floats:
        """(N,) calibrated confidence of the top class; per_mask False uses the calibrators of all modalities."""
        used = mask if per_mask else ALL_VALID
        return np.concatenate([own.confidence(logits, used) for own, logits in self._each(method, mask)])

    def right(self, mask: int = ALL_VALID) -> NDArray[np.bool_]:
        """(N,) whether the top class is the label; no calibrator changes it."""
        return np.asarray(self.logits(mask).argmax(axis=1) == self.labels)


def with_top_confidence(probabilities: Floats, confidence: Floats) -> Floats:
    """Distributions whose top class has `confidence`, the rest scaled to what is left: for NLL and Brier of Platt."""
    top = probabilities.argmax(axis=1)
    rows = np.arange(len(top))
    rest = (1.0 - confidence) / np.maximum(1.0 - probabilities[rows, top], 1e-12)
    made = probabilities * rest[:, None]
    made[rows, top] = confidence
    return np.asarray(made)


def _share(hits: NDArray[np.bool_], index: Ints) -> float:
    return float(hits[index].mean())


def _precision_at(confidence: Floats, right: NDArray[np.bool_], coverage: float, index: Ints) -> float:
    return metrics.precision_at_coverage(confidence[index], right[index], coverage)


def baseline(pooled: Pooled, taught: Pooled) -> list[Row]:
    """Top-1 and Top-5 with intervals by subject, beside the best possible predictor on the same windows.

    taught: a network that learnt from the best possible belief itself, see `experiments.run_network`.
    """
    predictors = (("GRU", pooled.logits()), (REACHABLE, taught.logits()), ("Bayes (best possible)", pooled.bayes))
    rows = []
    for name, scores in predictors:
        hits = scores.argmax(axis=1) == pooled.labels
        low, high = metrics.bootstrap(partial(_share, hits), pooled.subject)
        rows.append(
            {
                "model": name,
                "windows": len(hits),
                "effective_windows": round(metrics.effective_size(hits, pooled.subject)),
                "top1": float(hits.mean()),
                "top1_low": low,
                "top1_high": high,
                "top5": metrics.top_k(scores, pooled.labels, 5),
            }
        )
    rows.append({"model": "paper's GRU, EGTEA Gaze+ (another data set)", "top1": 0.402, "top5": 0.699})
    return rows


def calibration_table(pooled: Pooled) -> list[Row]:
    """E1: every calibrator, pooled over folds, with the noise floor of a perfect model of this size."""
    right = pooled.right()
    rows = []
    for method in Method:
        confidence = pooled.confidence(method)
        base = pooled.probabilities(method)
        full = base if method in (Method.NONE, Method.TEMPERATURE) else with_top_confidence(base, confidence)
        paper = PAPER.get(str(method), {})
        rows.append(
            {
                "method": str(method),
                "top1": float(right.mean()),
                "ece15": metrics.ece(confidence, right),
                "noise_floor": metrics.noise_floor(confidence),
                "debiased_ece": metrics.debiased_ece(confidence, right, seed=1),
                "ece15_equal_mass": metrics.ece(confidence, right, equal_mass=True),
                "smooth_ece": metrics.smooth_ece(confidence, right),
                "nll": metrics.nll(full, pooled.labels),
                "brier": metrics.brier(full, pooled.labels),
                "aurc": metrics.aurc(confidence, right),
                "augrc": metrics.augrc(confidence, right),
                "paper_ece15": paper.get("ece15"),
                "paper_nll": paper.get("nll"),
                "paper_brier": paper.get("brier"),
            }
        )
    return rows


def ablation_table(pooled: Pooled) -> list[Row]:
    """E2: one modality lost at test time; calibrators of this set of modalities against those fitted with all of them."""
    rows = []
    for lost in LOSSES:
        mask = mask_of(lost)
        right = pooled.right(mask)
        row: Row = {
            "lost": ", ".join(modality.name.lower() for modality in lost) or "nothing",
            "top1": float(right.mean()),
            "top5": metrics.top_k(pooled.logits(mask), pooled.labels, 5),
            "mean_confidence_global_temperature": float(
                pooled.confidence(Method.TEMPERATURE, mask, per_mask=False).mean()
            ),
        }
        for method in (Method.TEMPERATURE, Method.ISOTONIC):
            row[f"ece15_global_{method}"] = metrics.ece(pooled.confidence(method, mask, per_mask=False), right)
        for method in (Method.TEMPERATURE, Method.ISOTONIC):
            row[f"ece15_own_{method}"] = metrics.ece(pooled.confidence(method, mask), right)
        row["ratio"] = row["ece15_own_isotonic"] / row["ece15_global_temperature"]
        row["ratio_temperature"] = row["ece15_own_temperature"] / row["ece15_global_temperature"]
        row["noise_floor"] = metrics.noise_floor(pooled.confidence(Method.ISOTONIC, mask))
        rows.append(row)
    means = [name for name in rows[0] if name.startswith("ece15_")]
    mean: Row = {"lost": "any one (mean)"}
    mean.update({name: float(np.mean([row[name] for row in rows[1:]])) for name in [*means, "noise_floor"]})
    mean["ratio"] = mean["ece15_own_isotonic"] / mean["ece15_global_temperature"]
    mean["ratio_temperature"] = mean["ece15_own_temperature"] / mean["ece15_global_temperature"]
    chance = float(np.bincount(pooled.labels).max() / len(pooled.labels))
    return [*rows, mean, {"lost": "everything (most frequent verb)", "top1": chance}]


def curvature_table(pooled: Pooled) -> list[Row]:
    """E2: where the curvature of the loss lies (diagonal Fisher per parameter), mean over folds."""
    names = [name for name in pooled.folds[0] if name.startswith("curvature_")]
    values = {name: float(np.mean([fold[name] for fold in pooled.folds])) for name in names}
    total = sum(values.values()) or 1.0
    return [
        {"layer": name.removeprefix("curvature_"), "mean_fisher": value, "share": value / total}
        for name, value in sorted(values.items(), key=lambda item: -item[1])
    ]


def _without_ties(pooled: Pooled) -> Floats:
    """(N,) isotonic confidence, whose steps temperature breaks without changing their order."""
    return pooled.confidence(Method.ISOTONIC) + 1e-6 * pooled.confidence(Method.TEMPERATURE)


def selective_table(pooled: Pooled, taught: Pooled) -> list[Row]:
    """E3: act-only precision against coverage with intervals by subject, beside Bayes on the same windows."""
    fine, right = _without_ties(pooled), pooled.right()
    taught_fine, taught_right = _without_ties(taught), taught.right()
    bayes_confidence = pooled.bayes.max(axis=1)
    bayes_right = pooled.bayes.argmax(axis=1) == pooled.labels
    paper = {0.5: 0.65, 0.25: 0.80}
    rows = []
    for coverage in (1.0, 0.75, 0.5, 0.35, 0.25, 0.15, 0.1):
        low, high = metrics.bootstrap(partial(_precision_at, fine, right, coverage), pooled.subject, 200)
        rows.append(
            {
                "coverage": coverage,
                "act_only_precision": metrics.precision_at_coverage(fine, right, coverage),
                "low": low,
                "high": high,
                "taught_by_bayes": metrics.precision_at_coverage(taught_fine, taught_right, coverage),
                "bayes": metrics.precision_at_coverage(bayes_confidence, bayes_right, coverage),
                "paper (another data set)": paper.get(coverage),
            }
        )
    return rows


def threshold_table(pooled: Pooled) -> list[Row]:
    """E3: what a threshold means, calibrated and not, and the paper's region bound at it."""
    from hilbridge.learning.certificate.certify import region_bound

    rows = []
    for method in (Method.NONE, Method.ISOTONIC):
        confidence, right = pooled.confidence(method), pooled.right()
        for tau in (0.3, 0.4, 0.5, 0.6, 0.7, 0.8):
            precision, coverage = metrics.act_only_precision(confidence, right, tau)
            bound = region_bound(confidence, right, tau)
            rows.append(
                {
                    "method": str(method),
                    "tau": tau,
                    "act_only_precision": precision,
                    "coverage": coverage,
                    "epsilon": None if bound is None else bound.epsilon,
                    "tau_minus_epsilon": None if bound is None else tau - bound.epsilon,
                }
            )
    return rows


def verb_table(pooled: Pooled, tau: float = 0.5) -> list[Row]:
    """Act-only precision per predicted verb at one threshold."""
    made = metrics.precision_by_verb(
        pooled.logits().argmax(axis=1), pooled.confidence(Method.ISOTONIC), pooled.right(), tau
    )
    return [
        {"verb": VERBS[verb], "tau": tau, "act_only_precision": precision, "windows": count}
        for verb, (precision, count) in sorted(made.items(), key=lambda item: -item[1][1])
    ]


def comparator_table(pooled: Pooled, members: Mapping[str, Sequence[Fold]]) -> list[Row]:
    """Laplace, MC dropout, transformer and ensemble on the same windows, calibration by temperature where fitted."""
    labels, rows = pooled.labels, []

    def add(name: str, probabilities: Floats, truth: Ints, passes: str) -> None:
        confidence, right = probabilities.max(axis=1), probabilities.argmax(axis=1) == truth
        rows.append(
            {
                "model": name,
                "windows": len(truth),
                "top1": float(right.mean()),
                "nll": metrics.nll(probabilities, truth),
                "ece15": metrics.ece(confidence, right),
                "aurc": metrics.aurc(confidence, right),
                "forward_passes": passes,
            }
        )

    first = pooled.folds[0]
    checked = first["calibration_label"]
    add("GRU, uncalibrated", pooled.probabilities(Method.NONE), labels, "1")
    add("GRU, temperature", pooled.probabilities(Method.TEMPERATURE), labels, "1")
    for key, name, passes in (
        ("laplace", "GRU, last-layer Laplace", "1, and a quadratic form per class"),
        ("dropout", f"GRU, MC dropout of the head, {MC_PASSES} samples", f"1, and {MC_PASSES} of the head"),
    ):
        made = np.concatenate([fold[f"{key}_probabilities"] for fold in pooled.folds])
        add(name, made, labels, passes)
        # Fair to the comparators: they may have a temperature too.
        temperature = fit_temperature(_log(first[f"{key}_calibration"]), checked)
        add(f"{name}, temperature", softmax(_log(made) / temperature), labels, passes)
    for name, folds in members.items():
        if not folds:
            continue
        parts = [first, *folds] if name == "ensemble" else list(folds)
        scaled = []
        for fold in parts:
            temperature = fit_temperature(fold["calibration_logits_7"], fold["calibration_label"])
            scaled.append(softmax(fold["test_logits_7"] / temperature))
        title = f"ensemble of {len(parts)}, temperature each" if name == "ensemble" else f"{name}, temperature"
        add(title, np.mean(scaled, axis=0), first["test_label"], str(len(parts)))
    return rows


def _log(probabilities: Floats) -> Floats:
    return np.log(np.maximum(np.asarray(probabilities, dtype=np.float64), 1e-12))
