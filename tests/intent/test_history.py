"""The history filter: a belief at 25 Hz that needs no action boundaries and no labels."""

import numpy as np
import pytest

from hilbridge.intent.history import HistoryFilter, HistoryPrior

K = 3
CYCLE = np.array([[0.02, 0.96, 0.02], [0.02, 0.02, 0.96], [0.96, 0.02, 0.02]])  # 0 -> 1 -> 2 -> 0
EVEN = np.full(K, 1.0 / K)


def prior(trust: float = 0.2) -> HistoryPrior:
    return HistoryPrior(CYCLE, EVEN, EVEN, trust)


def test_belief_stays_a_distribution_and_starts_anew_after_a_gap():
    engine = HistoryFilter(prior(), 0.01)
    first = engine.step(np.array([0.8, 0.1, 0.1]))
    for _ in range(500):
        belief = engine.step(np.array([1.0, 0.0, 0.0]))
    assert belief.sum() == pytest.approx(1.0)
    assert belief[0] > 0.9
    engine.reset()
    assert engine.step(np.array([0.8, 0.1, 0.1])) == pytest.approx(first)


def test_without_evidence_the_belief_moves_on_as_the_transitions_say():
    engine = HistoryFilter(prior(), 0.02)
    for _ in range(200):
        engine.step(np.array([0.9, 0.05, 0.05]))
    for _ in range(40):
        belief = engine.step(EVEN)
    assert belief[1] > belief[2]


def test_history_settles_what_the_sensors_leave_open():
    """Labels follow the cycle; the sensors cannot tell 1 from 2. Only what was believed before can."""
    rng = np.random.default_rng(0)
    engine = HistoryFilter(prior(), 1.0 / 50.0)
    alone, fused = [], []
    for label in [0, 1, 2] * 40:
        for _ in range(50):
            p = np.array([0.8, 0.1, 0.1]) if label == 0 else np.array([0.1, 0.45, 0.45])
            p = p * np.exp(rng.normal(0.0, 0.05, K))
            p /= p.sum()
            belief = engine.step(p)
            alone.append(-np.log(p[label]))
            fused.append(-np.log(belief[label]))
    assert np.mean(fused) < np.mean(alone) - 0.05


def test_trust_of_nothing_forgets_the_sensors_and_wrong_settings_are_named():
    engine = HistoryFilter(prior(trust=0.0), 0.01)
    for _ in range(20):
        belief = engine.step(np.array([1.0, 0.0, 0.0]))
    assert belief == pytest.approx(EVEN, abs=1e-9)
    with pytest.raises(ValueError, match="hazard = 0"):
        HistoryFilter(prior(), 0.0)
