import numpy as np
import pytest

from hilbridge.learning.calibrators import Calibration, Method


@pytest.mark.parametrize("method", list(Method))
def test_calibration_never_changes_the_label(method):
    rng = np.random.default_rng(0)
    curves = {7: ((0.0, 0.2, 0.6, 1.0), (0.05, 0.1, 0.5, 0.9)), 3: ((0.0, 1.0), (0.2, 0.3))}
    calibration = Calibration(method, {7: 2.5, 3: 4.0}, (0.7, -1.0), curves)
    many = rng.normal(0.0, 3.0, size=(200, 21))
    for mask in (7, 3, 1):
        together = calibration.confidence(many, mask)
        for logits, expected in zip(many, together, strict=True):
            probabilities, top, confidence = calibration.apply(logits, mask)
            assert top == int(logits.argmax()) == int(probabilities.argmax())
            assert 0.0 <= confidence <= 1.0
            assert confidence == pytest.approx(float(expected), abs=1e-12)


def test_the_temperature_of_the_mask_is_used():
    calibration = Calibration(Method.TEMPERATURE, {7: 1.0, 3: 4.0})
    logits = np.array([3.0, 0.0, 0.0])
    assert calibration.apply(logits, 3)[2] < calibration.apply(logits, 7)[2]
    assert calibration.apply(logits, 5)[2] == calibration.apply(logits, 7)[2]


def test_the_curve_of_the_mask_is_used_and_that_of_all_modalities_where_there_is_none():
    curves = {7: ((0.0, 1.0), (0.0, 0.9)), 3: ((0.0, 1.0), (0.2, 0.3))}
    calibration = Calibration(Method.ISOTONIC, {7: 1.0}, isotonic=curves)
    logits = np.array([3.0, 0.0, 0.0])
    assert 0.2 <= calibration.apply(logits, 3)[2] <= 0.3
    assert calibration.apply(logits, 7)[2] > 0.7
    assert calibration.apply(logits, 5)[2] == calibration.apply(logits, 7)[2]


@pytest.mark.parametrize(
    "broken",
    [
        {"temperatures": {3: 1.0}},
        {"temperatures": {7: 0.0}},
        {"temperatures": {7: float("nan")}},
        {"temperatures": {7: 1.0, 8: 1.0}},
        {"platt": (float("inf"), 0.0)},
        {"isotonic": {7: ((0.0, 1.0), (0.9, 0.1))}},
        {"isotonic": {7: ((0.0,), (0.1,))}},
        {"isotonic": {7: ((0.0, 1.0), (0.0, float("nan")))}},
        {"isotonic": {3: ((0.0, 1.0), (0.0, 1.0))}},
        {"isotonic": {7: ((0.0, 1.0), (0.0, 1.0)), 8: ((0.0, 1.0), (0.0, 1.0))}},
    ],
)
def test_impossible_calibrators_are_refused(broken):
    with pytest.raises(ValueError):
        Calibration(**broken)
