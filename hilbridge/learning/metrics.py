"""Metrics with fixed definitions. Confidence is of the top class; `right` says whether that class was right.

References: ECE Guo 2017; debiased mean-square error Kumar 2019; smooth ECE Blasiok & Nakkiran 2023; AURC Geifman 2018;
AUGRC Traub 2024.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
BINS = 15


@dataclass(frozen=True, slots=True)
class Bin:
    """One bar of a reliability diagram."""

    low: float
    high: float
    count: int
    confidence: float
    accuracy: float


def reliability(confidence: Floats, right: Bools, bins: int = BINS, equal_mass: bool = False) -> list[Bin]:
    """Non-empty bins. Equal width: (low, high], with 0 in the first. Equal mass: neighbours in rank, ties in order."""
    confidence, right = np.asarray(confidence, dtype=np.float64), np.asarray(right, dtype=bool)
    if equal_mass:
        order = np.argsort(confidence, kind="stable")
        members = [part for part in np.array_split(order, min(bins, len(order))) if len(part)]
        edges = [(float(confidence[part].min()), float(confidence[part].max())) for part in members]
    else:
        place = np.clip(np.ceil(confidence * bins).astype(int) - 1, 0, bins - 1)
        members = [np.flatnonzero(place == number) for number in range(bins)]
        edges = [(number / bins, (number + 1) / bins) for number in range(bins)]
    return [
        Bin(low, high, len(part), float(confidence[part].mean()), float(right[part].mean()))
        for (low, high), part in zip(edges, members, strict=True)
        if len(part)
    ]


def ece(confidence: Floats, right: Bools, bins: int = BINS, equal_mass: bool = False) -> float:
    """Expected calibration error: the mean gap between confidence and accuracy, bins weighted by their size."""
    made = reliability(confidence, right, bins, equal_mass)
    total = sum(part.count for part in made)
    return sum(part.count * abs(part.confidence - part.accuracy) for part in made) / total


def noise_floor(confidence: Floats, bins: int = BINS, draws: int = 200, seed: int = 0) -> float:
    """The mean ECE of a perfectly calibrated model with these very confidences: what the sample size alone costs."""
    confidence = np.asarray(confidence, dtype=np.float64)
    place = np.clip(np.ceil(confidence * bins).astype(int) - 1, 0, bins - 1)
    rng = np.random.default_rng(seed)
    total = 0.0
    for _ in range(draws):
        gap = confidence - (rng.uniform(size=len(confidence)) < confidence)
        total += float(np.abs(np.bincount(place, weights=gap, minlength=bins)).sum()) / len(confidence)
    return total / draws


def debiased_ece(confidence: Floats, right: Bools, bins: int = BINS, seed: int = 0) -> float:
    """ECE less the noise floor of a perfect model of this size; may be negative, 0 is perfect."""
    return ece(confidence, right, bins) - noise_floor(confidence, bins, seed=seed)


def debiased_rms(confidence: Floats, right: Bools, bins: int = BINS) -> float:
    """Signed root of Kumar's debiased mean-square calibration error over equal-mass bins; may be negative."""
    made = [part for part in reliability(confidence, right, bins, equal_mass=True) if part.count > 1]
    total = sum(part.count for part in made)
    square = sum(
        part.count
        / total
        * ((part.confidence - part.accuracy) ** 2 - part.accuracy * (1.0 - part.accuracy) / (part.count - 1))
        for part in made
    )
    return float(np.sign(square) * np.sqrt(abs(square)))


def smooth_ece(confidence: Floats, right: Bools) -> float:
    """Smooth ECE: residuals smoothed by a reflected Gaussian whose width equals the value it gives (to 2^-10)."""
    confidence = np.asarray(confidence, dtype=np.float64)
    residual = confidence - np.asarray(right, dtype=np.float64)
    low, high = 0.0, 1.0
    if _smoothed_error(confidence, residual, 1.0) <= 1.0:
        for _ in range(10):
            middle = 0.5 * (low + high)
            if middle < 0.001 or middle < _smoothed_error(confidence, residual, middle):
                low = middle
            else:
                high = middle
        # The smallest width that is at least its own error; see the fixed point in the paper's section 4.
    return _smoothed_error(confidence, residual, low if high == 1.0 and low == 0.0 else high)


def _smoothed_error(confidence: Floats, residual: Floats, width: float) -> float:
    """Mean absolute smoothed residual at one kernel width, on a mesh of at least 200 points."""
    mesh = np.linspace(0.0, 1.0, max(round(10 / width), 200))
    cells = max(2000, round(20 / width)) // 2 + 1
    kernel_at = np.linspace(0.0, 1.0, cells)
    kernel = np.exp(-((kernel_at - 0.5) ** 2) / (2 * width**2)) / (np.sqrt(2 * np.pi) * width)

    def smooth(weights: Floats) -> Floats:
        grid = np.zeros(cells)
        place = np.clip((confidence * (cells - 1)).astype(int), 0, cells - 2)
        share = confidence * (cells - 1) - place
        np.add.at(grid, place, (1.0 - share) * weights)
        np.add.at(grid, place + 1, share * weights)
        reflected = np.concatenate([grid[::-1][:-1], grid, grid[::-1][1:]])
        middle = fftconvolve(reflected, kernel, "valid")[cells // 2 : cells // 2 + cells]
        position = np.clip((mesh * (cells - 1)).astype(int), 0, cells - 2)
        rest = mesh * (cells - 1) - position
        return np.asarray(middle[position] * (1.0 - rest) + middle[position + 1] * rest)

    density = smooth(np.ones_like(residual)) + 0.0001
    return float(np.sum(np.abs(smooth(residual) / density) * density) / np.sum(density))


def nll(probabilities: Floats, labels: Ints) -> float:
    """Mean negative log likelihood; probabilities (N, K) below 1e-12 count as that."""
    return float(-np.log(np.maximum(probabilities[np.arange(len(labels)), labels], 1e-12)).mean())


def brier(probabilities: Floats, labels: Ints) -> float:
    """Mean squared distance from the one-hot label, 0..2."""
    hot = np.zeros_like(probabilities)
    hot[np.arange(len(labels)), labels] = 1.0
    return float(((probabilities - hot) ** 2).sum(axis=1).mean())


def top_k(scores: Floats, labels: Ints, k: int) -> float:
    """Share of rows whose label is among the k highest scores (ties count half their share of places)."""
    own = scores[np.arange(len(labels)), labels][:, None]
    above = (scores > own).sum(axis=1)
    level = (scores == own).sum(axis=1)
    return float(np.clip((k - above) / level, 0.0, 1.0).mean())


def risk_coverage(confidence: Floats, right: Bools) -> tuple[Floats, Floats]:
    """Coverage i/N and selective risk for i = 1..N, most confident first; within a tie every order counts alike."""
    order = np.argsort(-np.asarray(confidence, dtype=np.float64), kind="stable")
    sorted_confidence, wrong = np.asarray(confidence)[order], 1.0 - np.asarray(right, dtype=np.float64)[order]
    starts = np.flatnonzero(np.concatenate([[True], np.diff(sorted_confidence) != 0.0]))
    sizes = np.diff(np.concatenate([starts, [len(wrong)]]))
    expected = np.repeat(np.add.reduceat(wrong, starts) / sizes, sizes)
    count = np.arange(1, len(wrong) + 1)
    return count / len(wrong), np.cumsum(expected) / count


def aurc(confidence: Floats, right: Bools) -> float:
    """Area under the risk-coverage curve, ties averaged: the order of the rows does not matter."""
    return float(risk_coverage(confidence, right)[1].mean())


def augrc(confidence: Floats, right: Bools) -> float:
    """Area under the generalised risk-coverage curve: the mean joint probability of being accepted and wrong."""
    coverage, risk = risk_coverage(confidence, right)
    return float((coverage * risk).mean())


def act_only_precision(confidence: Floats, right: Bools, tau: float) -> tuple[float, float]:
    """(precision among confidence >= tau, coverage); precision is NaN where nothing acts."""
    acting = np.asarray(confidence) >= tau
    return (float(np.asarray(right)[acting].mean()) if acting.any() else float("nan")), float(acting.mean())


def precision_at_coverage(confidence: Floats, right: Bools, coverage: float) -> float:
    """Act-only precision of the most confident share `coverage`, ties averaged."""
    at, risk = risk_coverage(confidence, right)
    return float(1.0 - np.interp(coverage, at, risk))


def precision_by_verb(predicted: Ints, confidence: Floats, right: Bools, tau: float) -> dict[int, tuple[float, int]]:
    """Per predicted class: (act-only precision, acting windows), classes that never act left out."""
    acting = np.asarray(confidence) >= tau
    made = {}
    for verb in np.unique(predicted[acting]):
        own = acting & (predicted == verb)
        made[int(verb)] = (float(np.asarray(right)[own].mean()), int(own.sum()))
    return made


def bootstrap(
    statistic: Callable[[Ints], float], cluster: Ints, draws: int = 400, level: float = 0.95, seed: int = 0
) -> tuple[float, float]:
    """Percentile interval of `statistic(indices)` when whole clusters (subjects) are drawn with replacement."""
    rng = np.random.default_rng(seed)
    members = [np.flatnonzero(cluster == name) for name in np.unique(cluster)]
    values = []
    for _ in range(draws):
        chosen = rng.integers(len(members), size=len(members))
        values.append(statistic(np.concatenate([members[number] for number in chosen])))
    tail = 0.5 * (1.0 - level)
    low, high = np.nanquantile(values, [tail, 1.0 - tail])
    return float(low), float(high)


def effective_size(right: Bools, cluster: Ints) -> float:
    """How many independent windows the clustered ones are worth, from the variance of the mean between clusters.

    N / design effect, where the design effect is the cluster-robust variance of the mean over the binomial one, at least 1.
    """
    hits = np.asarray(right, dtype=np.float64)
    variance = float(hits.var())
    names, place = np.unique(cluster, return_inverse=True)
    if variance == 0.0 or len(names) < 2:
        return float(len(names))
    sums = np.bincount(place, weights=hits - hits.mean())
    robust = float((sums**2).sum()) / len(hits) ** 2 * len(names) / (len(names) - 1)
    return float(len(hits) / max(1.0, robust * len(hits) / variance))
