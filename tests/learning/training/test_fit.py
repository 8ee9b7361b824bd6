from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("sklearn")

from hilbridge.confidence import ALL_VALID
from hilbridge.learning.calibrators import ISOTONIC_CAP, Method
from hilbridge.learning.experiments.benchmark import LOSSES, Plan, mask_of, network_path
from hilbridge.learning.metrics import ece
from hilbridge.learning.training.fit import fit_calibration, fit_isotonic

WITHOUT_HANDS = 0b101


def windows(count: int, claimed: float, seed: int):
    """Logits (N, 5) and labels of a network that believes `claimed` times the log odds that it should."""
    rng = np.random.default_rng(seed)
    logits = rng.normal(0.0, 1.5, size=(count, 5))
    odds = np.exp(logits)
    labels = (rng.uniform(size=(count, 1)) > np.cumsum(odds / odds.sum(axis=1, keepdims=True), axis=1)).sum(axis=1)
    return claimed * logits, np.minimum(labels, 4)


def test_every_set_of_modalities_gets_its_own_calibrators():
    fitted = fit_calibration(
        {ALL_VALID: windows(4_000, 1.0, 0), WITHOUT_HANDS: windows(4_000, 4.0, 1)}, Method.ISOTONIC
    )
    assert fitted.temperatures[ALL_VALID] == pytest.approx(1.0, abs=0.15)
    assert fitted.temperatures[WITHOUT_HANDS] == pytest.approx(4.0, rel=0.15)
    logits, labels = windows(4_000, 4.0, 2)
    right = logits.argmax(axis=1) == labels
    own, borrowed = (ece(fitted.confidence(logits, mask), right) for mask in (WITHOUT_HANDS, ALL_VALID))
    assert own <= 0.03
    assert own <= 0.2 * borrowed


def test_a_handful_of_lucky_windows_never_claims_certainty():
    for count in (3, 39, 200):
        x, y = fit_isotonic(np.linspace(0.5, 0.99, count), np.ones(count, dtype=bool))
        assert max(y) <= ISOTONIC_CAP
        assert list(x) == sorted(x)
    _, few = fit_isotonic(np.full(3, 0.5), np.ones(3, dtype=bool))
    assert max(few) <= 0.75


def test_another_plan_never_takes_the_answers_of_the_one_before(tmp_path):
    plan = Plan()
    kept = {network_path(plan, tmp_path, kind) for kind in ("gru", "member-1")}
    assert len(kept) == 2
    for other in (replace(plan, training=96), replace(plan, recipe=replace(plan.recipe, seed=5))):
        assert network_path(other, tmp_path, "gru") not in kept
    assert network_path(replace(plan, certificates=3), tmp_path, "gru") in kept


def test_nobody_is_in_two_parts_of_the_benchmark():
    everybody = [seed for own in Plan().seeds().values() for seed in own]
    assert len(set(everybody)) == len(everybody)
    assert {mask_of(lost) for lost in LOSSES} == {7, 6, 5, 3}
