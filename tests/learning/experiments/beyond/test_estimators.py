"""Estimators judged by decisions: the same order is the same decisions, noise is worse, and a difference is found."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("torch")

from hilbridge.learning.experiments.beyond.estimators import (
    COVERAGES,
    Estimator,
    estimator_rows,
    threshold_rows,
    what_changes_what,
)


@pytest.fixture(scope="module")
def made() -> tuple[dict[str, Estimator], np.ndarray]:
    rng = np.random.default_rng(0)
    truth = rng.uniform(0.1, 0.95, 4_000)
    right = rng.uniform(size=4_000) < truth
    noise = rng.uniform(size=4_000)
    named = {"temperature": truth, "squared": truth**2, "noise": noise}
    return {name: Estimator(value, value, right) for name, value in named.items()}, np.repeat(np.arange(40), 100)


def test_a_rising_map_changes_no_decision_at_matched_coverage(made) -> None:
    rows = {(row["estimator"], row["coverage"]): row for row in estimator_rows(*made)}
    for coverage in COVERAGES:
        same, worse = rows["squared", coverage], rows["noise", coverage]
        assert same["act_defer_agreement"] == 1.0
        assert same["less_temperature"] == same["less_temperature_low"] == same["less_temperature_high"] == 0.0
        assert same["equivalent"] == "yes"
        assert worse["equivalent"] == "not shown"
        assert worse["less_temperature_high"] < -0.02
        assert same["spearman"] == pytest.approx(rows["temperature", coverage]["spearman"])
        assert abs(worse["spearman"]) < 0.06 < same["spearman_low"]


def test_at_one_threshold_the_same_order_looks_like_another_precision(made) -> None:
    estimators, _ = made
    at = {(row["estimator"], row["tau"]): row for row in threshold_rows(estimators)}
    assert at["squared", 0.6]["act_only_precision"] > at["temperature", 0.6]["act_only_precision"] + 0.02
    assert at["squared", 0.6]["coverage"] < at["temperature", 0.6]["coverage"]
    said = what_changes_what({name: estimators[name] for name in ("temperature", "squared")})
    assert "at most 0.000 at coverage 0.5 and 0.000 at coverage 0.25" in said
