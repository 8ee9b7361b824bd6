"""A threshold with a finite-sample promise: P(act-only precision at tau_on < target) <= delta.

Windows of one person overlap and people differ, so the unit is the person, not the window. Two figures are called act-only
precision, and a promise is about one of them: that of the *average person* (among people who act, each counts alike) or the
*pooled* one (every tick counts alike, so who acts more counts more). Each candidate tau is tested in a fixed sequence from
strict to lax, from a start that other people chose.

- `betting` (default): bets on each acting person's share of wrong ticks, against an average person below target. Assumes
  only that people are drawn alike and independently. Keeps its promise; 30 people are certified half of the time.
- `betting_pooled`: the same for the pooled figure, where one person can weigh as much as they can act. Needs some 200.
- `cluster_t`: Student's bound on people's excess errors, pooled; assumes they are near normal. Broken a little too often.
- `clopper_pearson`: treats windows as independent. Here to be seen failing, never to be relied on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hilbridge.learning.metrics import reliability

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
TAUS: tuple[float, ...] = tuple(round(0.98 - 0.02 * step, 2) for step in range(40))
STARTS = 4
PILOT = 5
BETS = np.array([0.2, 0.4, 0.6, 0.8, 0.95, 0.999])
AVERAGE_PERSON = "precision of the average person who acts"
POOLED = "precision pooled over ticks"


class Method(StrEnum):
    """How the hypothesis `precision is below target` is tested."""

    BETTING = "betting"
    BETTING_POOLED = "betting_pooled"
    CLUSTER_T = "cluster_t"
    CLOPPER_PEARSON = "clopper_pearson"


ESTIMANDS = {
    Method.BETTING: AVERAGE_PERSON,
    Method.BETTING_POOLED: POOLED,
    Method.CLUSTER_T: POOLED,
    Method.CLOPPER_PEARSON: POOLED,
}
BOUNDS = {
    Method.BETTING: "a betting test of each acting person's share of wrong ticks; keeps its promise at any sample size",
    Method.BETTING_POOLED: "a betting test of each person's excess errors; keeps its promise at any sample size",
    Method.CLUSTER_T: "Student's bound on people's mean excess errors; approximate, broke its promise less often than allowed "
    "in simulation",
    Method.CLOPPER_PEARSON: "the binomial bound on windows; BREAKS its promise on overlapping windows, do not rely on it",
}
ASSUMES = {
    Method.BETTING: "people are drawn alike and independently; nothing about what happens within one",
    Method.BETTING_POOLED: "people are drawn alike and independently; nothing about what happens within one",
    Method.CLUSTER_T: "people are drawn alike and independently, and their mean excess error is near normal",
    Method.CLOPPER_PEARSON: "every window is independent of every other: false at 25 Hz, shown for comparison only",
}


@dataclass(frozen=True, slots=True)
class Counts:
    """Per candidate tau (rows, strict to lax) and cluster (columns): acting and wrong windows; `total` per cluster."""

    taus: tuple[float, ...]
    acting: Ints
    wrong: Ints
    total: Ints


@dataclass(frozen=True, slots=True)
class Certificate:
    """The answer. tau_on is None when the data cannot support the promise; then `clusters_needed` estimates what would
    (None: no number would, the observed precision is below target everywhere)."""

    tau_on: float | None
    precision: float
    delta: float
    method: Method
    clusters: int
    acting: int
    observed_precision: float
    person_precision: float
    coverage: float
    clusters_needed: int | None

    @property
    def estimand(self) -> str:
        """Which precision the promise is about."""
        return ESTIMANDS[self.method]

    def lines(self) -> list[str]:
        """For people: the answer, what it means, which bound it stands on and what that assumes."""
        bound = [f"bound: {self.method}, {BOUNDS[self.method]}", f"assumes: {ASSUMES[self.method]}"]
        if self.tau_on is not None:
            return [
                f"certified: tau_on {self.tau_on}",
                f"promise: P({self.estimand} < {self.precision}) <= {self.delta}. Done again with "
                f"{self.clusters} other people, a threshold below target would come out at most {self.delta:.1%} of the time",
                f"observed on these {self.clusters} people, {self.acting} of whom act: average person "
                f"{self.person_precision:.3f}, pooled {self.observed_precision:.3f}, coverage {self.coverage:.3f}",
                *bound,
            ]
        more = (
            f"more data: about {self.clusters_needed} people like these would do ({self.clusters_needed - self.clusters} more)"
            if self.clusters_needed is not None
            else "more data: no number of clusters would do, the observed precision is below target at every threshold; "
            "train a better predictor or ask for less"
        )
        easier = (
            f"or: --method {Method.CLUSTER_T} needs fewer people and assumes more"
            if self.method is Method.BETTING_POOLED and self.clusters_needed is not None
            else None
        )
        return [
            f"not certified: {self.clusters} clusters (people) cannot support act-only precision {self.precision} "
            f"at delta {self.delta}",
            more,
            *([easier] if easier else []),
            *self._at_best(),
            *bound,
        ]

    def _at_best(self) -> list[str]:
        """What nobody can do better than: so many people without a single wrong tick."""
        best = best_certifiable(self.clusters, self.delta)
        if self.method is not Method.BETTING or best >= self.precision:
            return []
        return [
            f"at best: {self.clusters} people without one wrong tick certify {best:.3f} at delta {self.delta}, not more"
        ]


def best_certifiable(people: int, delta: float) -> float:
    """The highest precision that so many people who are never wrong certify: each multiplies the wealth by 1 / precision."""
    return float(delta ** (1.0 / max(1, people)))


def window_counts(confidence: Floats, right: NDArray[np.bool_], cluster: Ints, taus: Sequence[float] = TAUS) -> Counts:
    """Counts for the paper's basic rule, ACT when confidence >= tau, on every window."""
    _, place = np.unique(cluster, return_inverse=True)
    count = int(place.max()) + 1
    acting = np.stack([np.bincount(place, weights=confidence >= tau, minlength=count) for tau in taus]).astype(int)
    wrong = np.stack(
        [np.bincount(place, weights=(confidence >= tau) & ~right, minlength=count) for tau in taus]
    ).astype(int)
    return Counts(tuple(taus), acting, wrong, np.bincount(place, minlength=count))


def certify(
    counts: Counts, precision: float, delta: float, method: Method = Method.BETTING, start: float | None = None
) -> Certificate:
    """The laxest tau that passes. start: where other people chose to begin; None: a fifth of these chooses and is not tested.

    Raises ValueError for a target or delta that is no probability.
    """
    for name, value in (("precision", precision), ("delta", delta)):
        if not 0.0 < value < 1.0:
            raise ValueError(f"{name} = {value}: must be between 0 and 1")
    if method in (Method.BETTING, Method.BETTING_POOLED):
        passed = _one_sequence(counts, precision, delta, method, start)
    else:
        passed = _fixed_sequences(_p_values(counts, slice(None), precision, method), delta)
    clusters = counts.acting.shape[1]
    if not passed:
        needed = _clusters_needed(counts, precision, delta, method)
        return Certificate(None, precision, delta, method, clusters, 0, float("nan"), float("nan"), 0.0, needed)
    best = max(passed, key=lambda row: int(counts.acting[row].sum()))
    own, own_wrong = counts.acting[best], counts.wrong[best]
    acts = own > 0
    acting, wrong = int(own.sum()), int(own_wrong.sum())
    return Certificate(
        counts.taus[best],
        precision,
        delta,
        method,
        clusters,
        int(acts.sum()),
        1.0 - wrong / acting,
        float(1.0 - (own_wrong[acts] / own[acts]).mean()),
        acting / int(counts.total.sum()),
        clusters,
    )


def promising_start(counts: Counts, precision: float, method: Method = Method.BETTING) -> float:
    """Where a sequence best begins, by people who are not tested then: the strictest tau if nothing looks good."""
    promise = _p_values(counts, slice(None), precision, method)
    return counts.taus[int(np.argmin(promise)) if min(promise) < 1.0 else 0]


def _p_values(counts: Counts, clusters: slice, precision: float, method: Method) -> list[float]:
    """One p-value per candidate tau, from some of the clusters."""
    return [
        _TESTS[method](acting[clusters], wrong[clusters], counts.total[clusters], precision)
        for acting, wrong in zip(counts.acting, counts.wrong, strict=True)
    ]


def _one_sequence(counts: Counts, precision: float, delta: float, method: Method, start: float | None) -> list[int]:
    """One sequence with all of delta: bets need many clusters, so none of it is wasted on starts without a chance.

    Clusters that chose the start must not be tested on.
    """
    pilots = 0
    if start is None:
        pilots = max(1, counts.acting.shape[1] // PILOT)
        first = slice(0, pilots)
        own = Counts(counts.taus, counts.acting[:, first], counts.wrong[:, first], counts.total[first])
        start = promising_start(own, precision, method)
    passed = []
    for row, p_value in enumerate(_p_values(counts, slice(pilots, None), precision, method)):
        if counts.taus[row] <= start + 1e-9:
            if p_value > delta:
                break
            passed.append(row)
    return passed


def _fixed_sequences(p_values: Sequence[float], delta: float) -> list[int]:
    """Rows passed by fixed-sequence testing from several starts, each with its share of delta.

    A sequence goes from strict to lax and ends at its first failure. One start at the strictest tau alone would mostly
    die there, where hardly anything acts; a sequence that passes all the way hands its share on to the next.
    """
    count = len(p_values)
    bounds = [round(start * count / STARTS) for start in range(STARTS + 1)]
    passed: list[int] = []
    budget = 0.0
    for start, stop in pairwise(bounds):
        budget += delta / STARTS
        rows = range(start, stop)
        survived = [row for row in rows if all(p_values[before] <= budget for before in range(start, row + 1))]
        passed.extend(survived)
        if len(survived) < len(rows):
            budget = 0.0
    return passed


def person_betting_p_value(acting: Ints, wrong: Ints, total: Ints, precision: float) -> float:
    """1 / wealth of a uniform mixture of bets against `mean over people who act of (wrong / acting) >= 1 - precision`.

    With x = (wrong / acting - (1 - precision)) / precision, at most 1, a factor 1 - bet * x is never negative and has a mean
    of at most 1 under that hypothesis, so by Markov's inequality the wealth exceeds 1 / delta with a chance of at most delta.
    """
    acts = acting > 0
    return _one_over_wealth((wrong[acts] / acting[acts] - (1.0 - precision)) / precision)


def _one_over_wealth(excess: Floats) -> float:
    log_wealth = np.log1p(-BETS[:, None] * excess[None, :]).sum(axis=1)
    highest = float(log_wealth.max())
    return float(min(1.0, np.exp(-highest) / np.exp(log_wealth - highest).mean()))


def pooled_betting_p_value(acting: Ints, wrong: Ints, total: Ints, precision: float) -> float:
    """1 / wealth of a uniform mixture of fixed bets against `mean(wrong - (1 - precision) acting) >= 0`.

    Each cluster's stake factor 1 - bet * x / x_max is non-negative with a mean of at most 1 under that hypothesis, so
    by Markov's inequality the wealth exceeds 1 / delta with a chance of at most delta.
    """
    return _one_over_wealth((wrong - (1.0 - precision) * acting) / (precision * float(total.max())))


def cluster_t_p_value(acting: Ints, wrong: Ints, total: Ints, precision: float) -> float:
    """Student's one-sided p-value of the same hypothesis over clusters."""
    excess = wrong - (1.0 - precision) * acting
    spread = float(excess.std(ddof=1)) if len(excess) > 1 else 0.0
    if spread == 0.0:
        return 1.0
    statistic = float(excess.mean()) / (spread / np.sqrt(len(excess)))
    return float(stats.t.cdf(statistic, df=len(excess) - 1))


def clopper_pearson_p_value(acting: Ints, wrong: Ints, total: Ints, precision: float) -> float:
    """The binomial p-value that takes every window for an independent one."""
    n, k = int(acting.sum()), int(wrong.sum())
    return float(stats.binom.cdf(k, n, 1.0 - precision)) if n else 1.0


_TESTS: dict[Method, Callable[[Ints, Ints, Ints, float], float]] = {
    Method.BETTING: person_betting_p_value,
    Method.BETTING_POOLED: pooled_betting_p_value,
    Method.CLUSTER_T: cluster_t_p_value,
    Method.CLOPPER_PEARSON: clopper_pearson_p_value,
}


def _clusters_needed(counts: Counts, precision: float, delta: float, method: Method) -> int | None:
    """Clusters like these until the most promising tau would pass with its share of delta."""
    promising = [row for row in range(len(counts.taus)) if _observed(counts, row) > precision]
    if not promising:
        return None
    clusters = counts.acting.shape[1]
    bets = method in (Method.BETTING, Method.BETTING_POOLED)
    share = delta if bets else delta / STARTS
    for factor in (1.25, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0, 64.0, 128.0, 256.0):
        size: int = round(clusters * factor)
        tested = np.resize(np.arange(clusters), size - size // PILOT if bets else size)
        total = counts.total[tested]
        for row in promising:
            if _TESTS[method](counts.acting[row][tested], counts.wrong[row][tested], total, precision) <= share:
                return size
    return None


def _observed(counts: Counts, row: int) -> float:
    acting = int(counts.acting[row].sum())
    return 1.0 - int(counts.wrong[row].sum()) / acting if acting else 0.0


@dataclass(frozen=True, slots=True)
class RegionBound:
    """The paper's bound on the region {confidence >= tau}: AOP >= mean confidence - epsilon >= tau - epsilon.

    epsilon is the largest gap between confidence and accuracy among the region's bins, as observed (no guarantee).
    """

    tau: float
    epsilon: float
    mean_confidence: float
    observed: float

    def lines(self) -> list[str]:
        """For people."""
        return [
            f"the paper's bound at tau {self.tau}: AOP {self.observed:.3f} >= mean confidence {self.mean_confidence:.3f} "
            f"- epsilon {self.epsilon:.3f} = {self.mean_confidence - self.epsilon:.3f} >= tau - epsilon = "
            f"{self.tau - self.epsilon:.3f} (epsilon as observed: no finite-sample guarantee)"
        ]


def region_bound(confidence: Floats, right: NDArray[np.bool_], tau: float, bins: int = 15) -> RegionBound | None:
    """The region form of the paper's bound, or None where nothing reaches tau."""
    inside = confidence >= tau
    if not inside.any():
        return None
    made = reliability(confidence[inside], right[inside], bins)
    epsilon = max(abs(part.confidence - part.accuracy) for part in made)
    return RegionBound(tau, epsilon, float(confidence[inside].mean()), float(right[inside].mean()))
