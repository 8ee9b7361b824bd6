import numpy as np
import pytest

pytest.importorskip("sklearn")

from hilbridge.learning.certificate.certify import (
    TAUS,
    betting_p_value,
    certify,
    cluster_t_p_value,
    region_bound,
    window_counts,
)
from hilbridge.learning.certificate.study import World, draw, study, true_curve


def test_counts_are_per_tau_and_person():
    counts = window_counts(
        np.array([0.99, 0.5, 0.9, 0.1]), np.array([True, False, False, True]), np.array([4, 4, 9, 9]), (0.9, 0.5)
    )
    assert counts.acting.tolist() == [[1, 1], [2, 1]]
    assert counts.wrong.tolist() == [[0, 1], [1, 1]]
    assert counts.total.tolist() == [2, 2]


@pytest.mark.parametrize(("p_value", "limit"), [(betting_p_value, 0.1), (cluster_t_p_value, 0.15)])
def test_at_the_border_of_the_hypothesis_small_p_values_are_rare(p_value, limit):
    rng = np.random.default_rng(0)
    rejected = 0
    for _ in range(400):
        # Precision of exactly 0.8 in the population, but people differ wildly.
        acting = rng.integers(0, 101, size=60)
        wrong = rng.binomial(acting, np.where(rng.uniform(size=60) < 0.4, 0.5, 0.0))
        rejected += p_value(acting, wrong, np.full(60, 100), 0.8) <= 0.1
    assert rejected / 400 <= limit


def test_betting_stays_valid_where_one_person_in_fifty_is_a_disaster():
    rng = np.random.default_rng(1)
    rejected = {"betting": 0, "t": 0}
    for _ in range(300):
        acting = np.full(30, 100)
        # Mean precision is 0.797: below target, through rare people for whom everything is wrong.
        wrong = np.where(rng.uniform(size=30) < 0.03, 100, 0) + rng.binomial(100, 0.18, size=30)
        wrong = np.minimum(wrong, 100)
        rejected["betting"] += betting_p_value(acting, wrong, acting, 0.8) <= 0.1
        rejected["t"] += cluster_t_p_value(acting, wrong, acting, 0.8) <= 0.1
    assert rejected["betting"] <= 30
    assert rejected["t"] > rejected["betting"]


def test_enough_people_are_certified_and_too_few_are_told_how_many_more():
    world = World()
    confidence, right, person = draw(world, 400, np.random.default_rng(2))
    certificate = certify(window_counts(confidence, right, person), 0.8, 0.05)
    assert certificate.tau_on in TAUS
    assert true_curve(world)[0][TAUS.index(certificate.tau_on)] >= 0.8
    assert "P(act-only precision < 0.8) <= 0.05" in certificate.lines()[1]
    assert "assumes: clusters are drawn alike" in certificate.lines()[-1]
    few = person < 20
    refused = certify(window_counts(confidence[few], right[few], person[few]), 0.8, 0.05)
    assert refused.tau_on is None
    assert refused.clusters_needed is not None
    assert 40 <= refused.clusters_needed <= 800
    assert f"({refused.clusters_needed - 20} more)" in refused.lines()[1]
    assert "cluster_t needs fewer people" in refused.lines()[2]


def test_a_hopeless_predictor_is_told_that_no_number_helps():
    rng = np.random.default_rng(3)
    confidence = rng.uniform(0.3, 1.0, size=2000)
    certificate = certify(window_counts(confidence, np.zeros(2000, dtype=bool), np.arange(2000) // 50), 0.8, 0.05)
    assert certificate.tau_on is None
    assert certificate.clusters_needed is None
    assert "no number of clusters would do" in certificate.lines()[1]


@pytest.mark.parametrize(("precision", "delta"), [(1.2, 0.05), (0.8, 0.0), (float("nan"), 0.05)])
def test_impossible_targets_are_refused(precision, delta):
    counts = window_counts(np.array([0.9]), np.array([True]), np.array([0]))
    with pytest.raises(ValueError, match="must be between 0 and 1"):
        certify(counts, precision, delta)


def test_the_study_sees_windowwise_bounds_break_and_clustered_ones_hold():
    rows = {row.method: row for row in study(60, 60, 0.8, 0.1)}
    assert rows["clopper_pearson"].violations > 0.18
    assert rows["cluster_t"].violations <= 0.15
    assert rows["betting"].violations <= 0.1
    assert rows["cluster_t"].coverage_lost > rows["clopper_pearson"].coverage_lost


def test_the_papers_region_bound():
    rng = np.random.default_rng(4)
    confidence = rng.uniform(0.2, 1.0, size=20_000)
    right = rng.uniform(size=20_000) < confidence - 0.05
    bound = region_bound(confidence, right, 0.7)
    assert bound is not None
    assert bound.epsilon == pytest.approx(0.05, abs=0.02)
    assert bound.observed >= bound.mean_confidence - bound.epsilon >= 0.7 - bound.epsilon
    assert region_bound(confidence, right, 1.1) is None
