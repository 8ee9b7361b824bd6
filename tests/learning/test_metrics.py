import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("sklearn")

from hilbridge.learning import metrics


def calibrated(n: int, seed: int = 0):
    rng = np.random.default_rng(seed)
    confidence = rng.uniform(0.1, 0.98, size=n)
    return confidence, rng.uniform(size=n) < confidence


def test_nll_and_brier_agree_with_scikit_learn():
    from sklearn.metrics import brier_score_loss, log_loss, top_k_accuracy_score

    rng = np.random.default_rng(1)
    p = rng.dirichlet(np.ones(21), size=500)
    y = rng.integers(21, size=500)
    assert metrics.nll(p, y) == pytest.approx(log_loss(y, p, labels=np.arange(21)), abs=1e-6)
    assert metrics.brier(p, y) == pytest.approx(brier_score_loss(np.eye(21)[y], p, scale_by_half=False), abs=1e-6)
    assert metrics.top_k(p, y, 5) == pytest.approx(top_k_accuracy_score(y, p, k=5, labels=np.arange(21)), abs=1e-6)


def test_nll_and_brier_agree_with_probmetrics():
    torch = pytest.importorskip("torch")
    probmetrics = pytest.importorskip("probmetrics.metrics")
    rng = np.random.default_rng(2)
    p = rng.dirichlet(np.ones(21), size=400)
    y = rng.integers(21, size=400)
    theirs = probmetrics.Metrics.from_names(["brier", "logloss"]).compute_all_from_labels_probs(
        torch.from_numpy(y), torch.from_numpy(p)
    )
    assert metrics.brier(p, y) == pytest.approx(float(theirs["brier"]), abs=1e-6)
    assert metrics.nll(p, y) == pytest.approx(float(theirs["logloss"]), abs=1e-6)


@pytest.mark.filterwarnings("ignore")
def test_smooth_ece_agrees_with_relplot():
    relplot = pytest.importorskip("relplot")
    for seed, shift in ((0, 0.0), (1, 0.2), (2, 0.45)):
        confidence, right = calibrated(1500, seed)
        confidence = np.clip(confidence + shift, 0.0, 1.0)
        assert metrics.smooth_ece(confidence, right) == pytest.approx(
            relplot.smECE(confidence, right.astype(float)), abs=1e-6
        )


def test_ece_by_hand():
    confidence = np.array([0.05, 0.05, 0.95, 0.95])
    right = np.array([False, False, True, False])
    assert metrics.ece(confidence, right) == pytest.approx(0.5 * 0.05 + 0.5 * 0.45)
    assert metrics.ece(np.array([1.0, 0.0]), np.array([True, False])) == 0.0
    # A bin's upper edge belongs to it.
    assert [part.low for part in metrics.reliability(np.array([1 / 15]), np.array([True]))] == [0.0]


def test_a_perfect_model_is_at_its_noise_floor_and_a_bad_one_is_not():
    values, squares = [], []
    for seed in range(20):
        confidence, right = calibrated(3000, seed)
        values.append(metrics.debiased_ece(confidence, right, seed=1_000 + seed))
        assert metrics.ece(confidence, right) > 0.004
        rms = metrics.debiased_rms(confidence, right)
        squares.append(rms * abs(rms))
    assert abs(np.mean(values)) < 0.002
    confidence, right = calibrated(3000, 5)
    assert metrics.debiased_ece(np.minimum(1.0, confidence + 0.3), right) > 0.2
    assert abs(np.mean(squares)) < 0.02**2
    assert metrics.debiased_rms(np.minimum(1.0, confidence + 0.3), right) > 0.2
    assert metrics.ece(confidence, right, equal_mass=True) < 0.04


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.sampled_from([0.1, 0.3, 0.3, 0.7, 0.9]), st.booleans()), min_size=2, max_size=40),
    st.randoms(),
)
def test_aurc_does_not_depend_on_the_order_of_rows(rows, random):
    shuffled = list(rows)
    random.shuffle(shuffled)
    one, other = (np.array(list(zip(*part, strict=True)), dtype=float) for part in (rows, shuffled))
    assert metrics.aurc(one[0], one[1] > 0) == pytest.approx(metrics.aurc(other[0], other[1] > 0), abs=1e-12)
    assert metrics.augrc(one[0], one[1] > 0) == pytest.approx(metrics.augrc(other[0], other[1] > 0), abs=1e-12)


def test_aurc_by_hand():
    confidence = np.array([0.9, 0.8, 0.7])
    right = np.array([True, False, True])
    assert metrics.aurc(confidence, right) == pytest.approx((0 + 1 / 2 + 1 / 3) / 3)
    assert metrics.augrc(confidence, right) == pytest.approx((0 + 1 / 3 + 1 / 3) / 3)
    assert metrics.precision_at_coverage(confidence, right, 2 / 3) == pytest.approx(0.5)
    tied = np.array([0.5, 0.5])
    assert metrics.aurc(tied, np.array([True, False])) == pytest.approx(0.5)


def test_act_only_precision_and_by_verb():
    confidence = np.array([0.9, 0.9, 0.4, 0.8])
    right = np.array([True, False, True, True])
    assert metrics.act_only_precision(confidence, right, 0.8) == (pytest.approx(2 / 3), 0.75)
    precision, coverage = metrics.act_only_precision(confidence, right, 0.95)
    assert np.isnan(precision)
    assert coverage == 0.0
    by_verb = metrics.precision_by_verb(np.array([1, 1, 2, 2]), confidence, right, 0.8)
    assert by_verb == {1: (0.5, 2), 2: (1.0, 1)}


def test_top_k_counts_ties_by_their_share():
    assert metrics.top_k(np.zeros((1, 10)), np.array([3]), 5) == pytest.approx(0.5)


def test_bootstrap_by_subject_is_wider_than_by_window_where_subjects_differ():
    rng = np.random.default_rng(3)
    subject = np.repeat(np.arange(16), 100)
    right = rng.uniform(size=1600) < np.repeat(rng.uniform(0.2, 0.9, size=16), 100)

    def mean(index):
        return float(right[index].mean())

    low, high = metrics.bootstrap(mean, subject)
    window_low, window_high = metrics.bootstrap(mean, np.arange(1600))
    assert high - low > 2 * (window_high - window_low)
    assert low < right.mean() < high
    assert metrics.effective_size(right, subject) < 200
    independent = rng.uniform(size=1600) < 0.5
    assert metrics.effective_size(independent, subject) > 700
