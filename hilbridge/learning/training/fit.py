"""Fitting calibrators on held-out logits (paper, "Calibration"). Never fit and judge on the same windows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar
from sklearn.isotonic import IsotonicRegression

from hilbridge.confidence import ALL_VALID
from hilbridge.intent.calibration import softmax
from hilbridge.learning.calibrators import ISOTONIC_CAP, Calibration, Knots, Method

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
MIN_PER_KNOT = 40
SMOOTHING = 4.0  # pseudo-windows that believe the confidence as it stands


def nll(logits: Floats, labels: Ints) -> float:
    """Mean negative log likelihood of softmax(logits)."""
    probabilities = softmax(np.asarray(logits, dtype=np.float64))
    return float(-np.log(np.maximum(probabilities[np.arange(len(labels)), labels], 1e-12)).mean())


def fit_temperature(logits: Floats, labels: Ints) -> float:
    """The T in 0.05..20 that minimises the NLL of softmax(logits / T) (Guo et al. 2017)."""
    values = np.asarray(logits, dtype=np.float64)
    found = minimize_scalar(lambda log_t: nll(values / np.exp(log_t), labels), bounds=(np.log(0.05), np.log(20.0)))
    return float(np.exp(found.x))


def fit_platt(logits: Floats, labels: Ints) -> tuple[float, float]:
    """Slope and offset of the logistic from the top centred logit to being right, with Platt's smoothed targets."""
    values = np.asarray(logits, dtype=np.float64)
    top = values.max(axis=1) - values.mean(axis=1)
    right = (values.argmax(axis=1) == labels).astype(float)
    hits = right.sum()
    target = np.where(right > 0, (hits + 1) / (hits + 2), 1 / (len(right) - hits + 2))

    def loss(ab: Floats) -> tuple[float, Floats]:
        z = ab[0] * top + ab[1]
        residual = 0.5 * (1 + np.tanh(0.5 * z)) - target
        value = float((np.logaddexp(0.0, z) - target * z).mean())
        return value, np.array([(residual * top).mean(), residual.mean()])

    slope, offset = minimize(loss, np.array([1.0, 0.0]), jac=True, method="BFGS").x
    return float(slope), float(offset)


def fit_isotonic(confidence: Floats, right: NDArray[np.bool_]) -> Knots:
    """Knots of a rising map from confidence to the chance of being right, at most 0.99.

    Windows are pooled into groups of at least 40 first and each group is pulled towards its own confidence by four
    pseudo-windows, so a handful of lucky windows at the top never claims certainty.
    """
    order = np.argsort(confidence, kind="stable")
    groups = np.array_split(order, int(np.clip(len(order) // MIN_PER_KNOT, 1, 40)))
    x = np.array([confidence[group].mean() for group in groups])
    hits = np.array([right[group].sum() for group in groups], dtype=float)
    count = np.array([len(group) for group in groups], dtype=float)
    y = (hits + SMOOTHING * x) / (count + SMOOTHING)
    rising = IsotonicRegression(y_min=0.0, y_max=ISOTONIC_CAP).fit_transform(x, y, sample_weight=count)
    # Flat beyond the outermost knots: there is nothing to extrapolate from.
    xs = (0.0, *(float(number) for number in np.maximum.accumulate(x)), 1.0)
    ys = (float(rising[0]), *(float(number) for number in rising), float(rising[-1]))
    return xs, ys


def fit_calibration(logits_by_mask: Mapping[int, tuple[Floats, Ints]], method: Method) -> Calibration:
    """All calibrators from held-out logits and labels; temperature and isotonic for each set of valid modalities.

    logits_by_mask: mask -> ((N, K), (N,)); ALL_VALID must be there: Platt is fitted on it.
    """
    temperatures: dict[int, float] = {}
    isotonic: dict[int, Knots] = {}
    for mask, (logits, labels) in logits_by_mask.items():
        temperatures[mask] = fit_temperature(logits, labels)
        top = softmax(np.asarray(logits, dtype=np.float64) / temperatures[mask]).max(axis=1)
        isotonic[mask] = fit_isotonic(top, logits.argmax(axis=1) == labels)
    return Calibration(method, temperatures, fit_platt(*logits_by_mask[ALL_VALID]), isotonic)
