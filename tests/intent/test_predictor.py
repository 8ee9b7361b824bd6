from dataclasses import replace

import numpy as np
import pytest

from hilbridge.features.assembler import FeatureAssembler
from hilbridge.features.layout import STEP_NS
from hilbridge.intent.bundle import demo_bundle_path, load_bundle
from hilbridge.intent.calibration import checked_temperatures, sigmoid, softmax
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


def test_each_set_of_modalities_has_its_temperature_and_names_its_condition(bundle):
    cooler = replace(bundle, temperatures={**bundle.temperatures, 0b101: 10.0})
    made = []
    for one in (bundle, cooler):
        predictor = Predictor(one)
        made.append([predictor.step(vector, 0) for vector in vectors(14, 60, (Modality.HANDS,))][-1])
    assert made[0].condition == made[1].condition == 0b101
    assert made[0].verb_index == made[1].verb_index
    assert made[1].confidence < made[0].confidence


@pytest.mark.parametrize(
    "temperatures", [{7: 1.0}, dict.fromkeys(range(1, 8), 0.0), {mask: float("nan") for mask in range(1, 8)}]
)
def test_impossible_temperatures_are_refused(temperatures):
    with pytest.raises(ValueError, match="temperature"):
        checked_temperatures(temperatures)


def test_extreme_logits_do_not_overflow():
    assert np.isfinite(softmax(np.array([1e300, -1e300, 0.0]))).all()
    assert sigmoid(-1e9) == 0.0
    assert sigmoid(1e9) == 1.0
