"""How one person differs: a random intercept on the log odds of being right, learnt from actions whose verb became known.

Its spread over people comes from their marginal likelihood; one person's posterior leans on everybody's for as long as there
is little to go by. An action counts once, whatever it lasts: its ticks say nearly the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from hilbridge.confidence import ConfidenceMaps, RisingMap
from hilbridge.learning.training.replay import Replay

Floats = NDArray[np.float64]
GRID = np.linspace(-6.0, 6.0, 241)
MOST_SPREAD = 3.0
CLIP = 1e-3


@dataclass(frozen=True, slots=True)
class Actions:
    """One person's acts: the confidence with which each began, and whether its verb was right."""

    confidence: Floats
    right: NDArray[np.bool_]


def actions_of(done: Replay, subject: NDArray[np.int64]) -> dict[int, Actions]:
    """The acts of each person in a replay, of those whose truth is known when they begin."""
    before = np.r_[-1, done.verb[:-1]]
    begins = done.judged & ((done.verb != before) | np.r_[True, subject[1:] != subject[:-1]])
    return {
        int(person): Actions(done.confidence[begins & (subject == person)], done.right[begins & (subject == person)])
        for person in np.unique(subject)
    }


def log_likelihood(actions: Actions) -> Floats:
    """Of each intercept on the grid."""
    p = np.clip(actions.confidence, CLIP, 1.0 - CLIP)
    z = np.log(p / (1.0 - p))[None, :] + GRID[:, None]
    return np.asarray(np.where(actions.right[None, :], -np.logaddexp(0.0, -z), -np.logaddexp(0.0, z)).sum(axis=1))


def fit_spread(people: Sequence[Actions]) -> float:
    """Standard deviation of the intercept over people, by marginal likelihood; 0 where nothing says that they differ."""
    likelihoods = [log_likelihood(one) for one in people if len(one.right)]
    if len(likelihoods) < 2:
        return 0.0

    def loss(spread: float) -> float:
        prior = _prior(spread)
        return -sum(float(np.logaddexp.reduce(own + prior)) for own in likelihoods)

    found = minimize_scalar(loss, bounds=(0.05, MOST_SPREAD), method="bounded")
    nobody_differs = -sum(float(own[len(GRID) // 2]) for own in likelihoods)
    return float(found.x) if float(found.fun) < nobody_differs else 0.0


def posterior(actions: Actions, spread: float) -> tuple[float, float]:
    """Mean and standard deviation of this person's intercept."""
    if spread <= 0.0:
        return 0.0, 0.0
    log_weight = log_likelihood(actions) + _prior(spread)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    mean = float((weight * GRID).sum())
    return mean, float(np.sqrt((weight * (GRID - mean) ** 2).sum()))


def shifted(maps: ConfidenceMaps, intercept: float) -> ConfidenceMaps:
    """Every confidence moved by so many log odds; 0 stays 0."""
    return ConfidenceMaps(
        {
            condition: RisingMap(own.x, tuple(_moved(value, intercept) for value in own.y))
            for condition, own in maps.by_condition.items()
        }
    )


def _moved(value: float, intercept: float) -> float:
    if value <= 0.0:
        return 0.0
    if value >= 1.0:
        return 1.0
    return float(1.0 / (1.0 + np.exp(-(np.log(value / (1.0 - value)) + intercept))))


def _prior(spread: float) -> Floats:
    raw = -0.5 * (GRID / max(spread, 1e-3)) ** 2
    return np.asarray(raw - np.logaddexp.reduce(raw))
