import numpy as np
import pytest

from hilbridge.features.assembler import FeatureAssembler
from hilbridge.features.layout import STEP_NS
from hilbridge.intent.bundle import demo_bundle_path, load_bundle
from hilbridge.intent.calibration import Calibration, Method, sigmoid
from hilbridge.intent.predictor import Predictor
from hilbridge.records import Modality
from hilbridge.wearer.person import Wearer


@pytest.fixture(scope="module")
def bundle():
    return load_bundle(demo_bundle_path())


def vectors(seed, steps, lost=()):
    wearer, assembler = Wearer(seed, width_px=96, height_px=72), FeatureAssembler()
    for step in range(steps):
        t = step * STEP_NS
        yield assembler.update(
            None if Modality.SCENE in lost else wearer.frame(t),
            None if Modality.GAZE in lost else wearer.gaze(t),
            None if Modality.HANDS in lost else wearer.hands(t),
            t,
        )


def test_belief_starts_after_two_seconds_and_is_a_distribution(bundle):
    predictor = Predictor(bundle)
    estimates = [predictor.step(vector, 7 + index) for index, vector in enumerate(vectors(11, 80))]
    assert all(estimate is None for estimate in estimates[:49])
    for index, estimate in enumerate(estimates[49:], start=49):
        assert estimate is not None
        assert sum(estimate.probabilities) == pytest.approx(1.0)
        assert estimate.probabilities[estimate.verb_index] == max(estimate.probabilities)
        assert 0.0 <= estimate.confidence <= 1.0
        assert estimate.produced_ns == 7 + index
        assert estimate.bundle_id == bundle.bundle_id


def test_same_input_same_belief_after_reset(bundle):
    predictor = Predictor(bundle)
    first = [predictor.step(vector, 0) for vector in vectors(12, 60)]
    predictor.reset()
    assert [predictor.step(vector, 0) for vector in vectors(12, 60)] == first


def test_half_a_window_without_input_is_no_belief(bundle):
    predictor = Predictor(bundle)
    assembler = FeatureAssembler()
    seen = []
    for index, vector in enumerate(vectors(13, 120)):
        blind = 60 <= index < 90
        used = assembler.update(None, None, None, index * STEP_NS) if blind else vector
        seen.append(predictor.step(used, 0) is not None)
    assert seen[49:60] == [True] * 11
    # The 26th blind step leaves 24 of 50: too few, until enough of them have left the window.
    assert seen.index(False, 60) == 85
    assert seen[-1]


@pytest.mark.parametrize(("lost", "mask"), [((Modality.HANDS,), 0b101), ((Modality.GAZE, Modality.SCENE), 0b010)])
def test_the_mask_names_what_the_window_mostly_had(bundle, lost, mask):
    predictor = Predictor(bundle)
    for vector in vectors(14, 60, lost):
        predictor.step(vector, 0)
    assert predictor.mask() == mask


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


def test_extreme_logits_do_not_overflow():
    probabilities, _, confidence = Calibration().apply(np.array([1e300, -1e300, 0.0]), 7)
    assert np.isfinite(probabilities).all()
    assert confidence == 1.0
    assert sigmoid(-1e9) == 0.0
    assert sigmoid(1e9) == 1.0


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
