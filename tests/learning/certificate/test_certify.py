import numpy as np
import pytest

pytest.importorskip("sklearn")

from hilbridge.learning.certificate.certify import (
    AVERAGE_PERSON,
    TAUS,
    Method,
    best_certifiable,
    certify,
    cluster_t_p_value,
    person_betting_p_value,
    pooled_betting_p_value,
    promising_start,
    region_bound,
    window_counts,
)
from hilbridge.learning.certificate.study import World, draw, study, true_curves


def test_counts_are_per_tau_and_person():
    counts = window_counts(
        np.array([0.99, 0.5, 0.9, 0.1]), np.array([True, False, False, True]), np.array([4, 4, 9, 9]), (0.9, 0.5)
    )
    assert counts.acting.tolist() == [[1, 1], [2, 1]]
    assert counts.wrong.tolist() == [[0, 1], [1, 1]]
    assert counts.total.tolist() == [2, 2]


@pytest.mark.parametrize(("p_value", "limit"), [(pooled_betting_p_value, 0.1), (cluster_t_p_value, 0.15)])
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
        rejected["betting"] += pooled_betting_p_value(acting, wrong, acting, 0.8) <= 0.1
        rejected["t"] += cluster_t_p_value(acting, wrong, acting, 0.8) <= 0.1
    assert rejected["betting"] <= 30
    assert rejected["t"] > rejected["betting"]


def test_enough_people_are_certified_and_too_few_are_told_how_many_more():
    world = World()
    confidence, right, person = draw(world, 400, np.random.default_rng(2))
    certificate = certify(window_counts(confidence, right, person), 0.8, 0.05)
    assert certificate.tau_on in TAUS
    assert true_curves(world)[0][AVERAGE_PERSON][TAUS.index(certificate.tau_on)] >= 0.8
    assert "P(precision of the average person who acts < 0.8) <= 0.05" in certificate.lines()[1]
    assert "average person 0." in certificate.lines()[2]
    assert "pooled 0." in certificate.lines()[2]
    assert "assumes: people are drawn alike" in certificate.lines()[-1]
    few = person < 14
    counts = window_counts(confidence[few], right[few], person[few])
    refused = certify(counts, 0.8, 0.05)
    assert refused.tau_on is None
    assert refused.clusters_needed is not None
    assert 14 < refused.clusters_needed <= 200
    assert f"({refused.clusters_needed - 14} more)" in refused.lines()[1]
    pooled = certify(counts, 0.8, 0.05, Method.BETTING_POOLED)
    assert pooled.tau_on is None
    assert "cluster_t needs fewer people" in pooled.lines()[2]


def test_what_so_few_people_certify_at_best_is_said():
    assert best_certifiable(10, 0.1) == pytest.approx(0.794, abs=1e-3)
    counts = window_counts(np.full(100, 0.9), np.ones(100, dtype=bool), np.arange(100) // 10)
    refused = certify(counts, 0.8, 0.1, start=0.9)
    assert refused.tau_on is None
    assert "at best: 10 people without one wrong tick certify 0.794" in " ".join(refused.lines())
    assert certify(counts, 0.6, 0.1, start=0.9).tau_on is not None


def test_people_who_choose_the_start_are_others_and_a_person_counts_once():
    rng = np.random.default_rng(5)
    acting = rng.integers(1, 101, size=200)
    share = np.where(rng.uniform(size=200) < 0.25, 0.8, 0.0)  # the average person is right four times in five
    rejected = sum(
        person_betting_p_value(
            a := acting[rng.permutation(200)[:60]], rng.binomial(a, rng.permutation(share)[:60]), a, 0.8
        )
        <= 0.1
        for _ in range(400)
    )
    assert rejected / 400 <= 0.1
    counts = window_counts(*draw(World(), 90, np.random.default_rng(6)))
    assert promising_start(counts, 0.8) in TAUS
    hopeless = window_counts(np.full(50, 0.9), np.zeros(50, dtype=bool), np.arange(50) // 10)
    assert promising_start(hopeless, 0.8) == TAUS[0]


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
    assert rows["clopper_pearson_events"].violations < rows["clopper_pearson"].violations
    for method in ("betting", "betting_pooled"):
        assert rows[method].violations <= 0.1
    assert rows["betting"].certified >= 0.8 > rows["betting_pooled"].certified
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
