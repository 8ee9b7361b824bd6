from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from hilbridge.features.layout import STEP_NS  # noqa: E402
from hilbridge.intent.bundle import demo_bundle_path, load_bundle  # noqa: E402
from hilbridge.intent.predictor import Predictor  # noqa: E402
from hilbridge.intent.provenance import Origin  # noqa: E402
from hilbridge.learning.data.stream import Stream  # noqa: E402
from hilbridge.learning.data.synthetic import record, record_people  # noqa: E402
from hilbridge.learning.data.windows import STEPS, Statistics, gather, onset_ends, window_ends  # noqa: E402
from hilbridge.learning.training.gate_fit import GATE  # noqa: E402
from hilbridge.learning.training.make_bundle import TrainConfig, replay_bundle, train  # noqa: E402
from hilbridge.learning.training.recipes import DEMO_RECIPE, Recipe  # noqa: E402
from hilbridge.learning.training.replay import conditions, stream_logits, watch  # noqa: E402
from hilbridge.learning.training.train import class_weights, fit_network  # noqa: E402
from hilbridge.records import FeatureVector, Modality  # noqa: E402
from hilbridge.verbs import VERBS  # noqa: E402
from hilbridge.wearer.timeline import DEMO  # noqa: E402

SMALL = Recipe(hidden=16, inner=8, epochs=3, windows_per_epoch=256, averaging=0.5, seed=4)


@pytest.fixture(scope="module")
def people() -> Stream:
    return record_people(range(5_000, 5_003), DEMO, 20.0)


def test_windows_stay_with_one_person_and_end_where_they_say(people):
    ends = window_ends(people)
    assert len(ends) == 3 * (500 - STEPS + 1)
    x, usable = gather(people, ends[:2], Statistics(np.zeros(55, np.float32), np.ones(55, np.float32)))
    assert x.shape == (2, STEPS, 55)
    assert usable.all()
    assert x[0, -1] == pytest.approx(np.clip(people.values[ends[0]], -8, 8))
    assert (people.onset_steps[onset_ends(people)] == 13).all()


def test_modality_dropout_drops_whole_modalities_of_some_windows(people):
    ends = window_ends(people)[:400]
    statistics = Statistics(np.zeros(55, np.float32), np.ones(55, np.float32))
    x, usable = gather(people, ends, statistics, rng=np.random.default_rng(0), dropout=0.5)
    gaze_gone = (x[:, :, 2] == 0).all(axis=1)
    scene_gone = (x[:, :, 15:35] == 0).all(axis=(1, 2))
    assert 0.15 < gaze_gone.mean() < 0.45
    assert 0.15 < scene_gone.mean() < 0.45
    assert usable.any(axis=1).all()


def test_class_weights_are_taken_back_by_the_offset():
    labels = np.array([0] * 90 + [1] * 10)
    weights = class_weights(labels, 1.0)
    assert weights[labels].mean() == pytest.approx(1.0)
    assert weights[1] / weights[0] == pytest.approx(91 / 11)
    assert class_weights(labels, 0.0) == pytest.approx(np.ones(len(VERBS)))


def test_training_learns_is_seeded_and_resumes_to_the_same_network(people, tmp_path):
    whole = fit_network(SMALL, people, people, tmp_path / "whole")
    assert whole.history[-1]["loss"] < whole.history[0]["loss"]
    # Stop after one epoch as an interruption would: the checkpoint says epoch 0, the recipe is the same.
    folder = tmp_path / "cut"
    fit_network(SMALL, people, people, folder, stop_after=1)
    resumed = fit_network(SMALL, people, people, folder)
    assert [row["validation_nll"] for row in resumed.history] == [row["validation_nll"] for row in whole.history]
    for name, value in whole.network.state_dict().items():
        assert torch.equal(value, resumed.network.state_dict()[name])
    assert (folder / "train.csv").read_text().splitlines()[0] == "epoch,loss,validation_nll,top1"
    other = fit_network(replace(SMALL, seed=5), people, people, folder)
    assert other.history[0]["loss"] != whole.history[0]["loss"]


def test_averaging_keeps_other_weights_and_none_is_the_weights_themselves(people):
    once = replace(SMALL, epochs=1)
    averaged, plain = fit_network(once, people, people), fit_network(replace(once, averaging=0.0), people, people)
    assert averaged.history[0]["loss"] == plain.history[0]["loss"]
    assert not torch.equal(averaged.network.head.weight, plain.network.head.weight)


def test_a_taught_network_learns_the_belief_whatever_verb_followed(people):
    taught = replace(SMALL, taught=True, label_smoothing=0.0, class_weight_power=0.0)
    other = replace(people, label=np.roll(people.label, 1))
    weights = [fit_network(taught, data, people).last_weights for data in (people, other)]
    assert all(torch.equal(value, weights[1][name]) for name, value in weights[0].items())


def test_replay_sees_what_the_live_chain_sees(people):
    bundle = load_bundle(demo_bundle_path())
    logits = stream_logits(bundle.weights, people, Statistics(bundle.mean, bundle.std))
    assert np.isnan(logits[::500]).all()
    masks = conditions(people)
    seen = watch(logits, masks, people.subject, bundle.temperatures, replace(GATE, alpha=1.0))
    predictor = Predictor(bundle)
    for index in range(500):
        valid = tuple(bool(flag) for flag in people.valid[index])
        live = predictor.step(FeatureVector(0, 0, people.values[index], valid), 0)
        assert (live is None) == (seen.candidate[index] < 0)
        if live is not None:
            assert live.condition == seen.condition[index] & 0b111
            assert live.verb_index == seen.candidate[index]
            assert live.probabilities == pytest.approx(seen.smoothed[index], abs=1e-6)
    never = replay_bundle(bundle, people, 1.0)
    assert never.coverage == 0.0
    assert np.isnan(never.act_only_precision)


@pytest.fixture(scope="module")
def strangers() -> Stream:
    return record_people(range(90, 102), DEMO, 60.0)


@pytest.mark.parametrize("tau_on", [0.5, 0.6, 0.7, 0.8, 0.9])
def test_h6_the_demo_bundles_threshold_means_what_it_says_on_people_it_has_never_seen(strangers, tau_on):
    done = replay_bundle(load_bundle(demo_bundle_path()), strangers, tau_on)
    assert done.act_only_precision >= tau_on - 0.03  # twelve people
    assert done.mean_confidence - done.act_only_precision <= 0.05
    assert done.coverage >= 0.15


def test_precision_asked_for_is_reached_on_strangers(strangers):
    bundle = load_bundle(demo_bundle_path())
    for precision in (0.85, 0.9):
        done = replay_bundle(bundle, strangers, bundle.tau_for(precision))
        assert done.act_only_precision >= precision - 0.04


def test_train_writes_a_bundle_that_runs(tmp_path):
    recipe = replace(SMALL, epochs=1)
    config = TrainConfig(
        tmp_path / "b.safetensors", tmp_path / "work", people=8, seconds=20.0, precision=0.0, recipe=recipe
    )
    bundle = load_bundle(train(config))
    assert bundle.provenance.people == 8
    assert bundle.provenance.origin is Origin.SIMULATED
    assert bundle.provenance.recipe["hidden"] == 16
    assert bundle.curve
    with pytest.raises(ValueError, match="wearer 'nobody'"):
        train(replace(config, wearer="nobody"))
    with pytest.raises(ValueError, match="people = 3"):
        train(replace(config, people=3))


def test_recording_is_the_same_from_cache(tmp_path):
    fresh = record_people([6_000], DEMO, 3.0, tmp_path)
    stored = record_people([6_000], DEMO, 3.0, tmp_path)
    assert (fresh.values == stored.values).all()
    assert (stored.label == record(6_000, DEMO, 3.0).label).all()
    other = replace(DEMO, mixture=((1.0, 0.0, 0.0),))
    assert (record_people([6_000], other, 3.0, tmp_path).bayes != stored.bayes).any()  # other people of the same name
    assert STEP_NS == 40_000_000
    assert Modality.GAZE == 0


def test_the_shipped_bundle_was_made_by_the_recipe_that_train_has():
    provenance = load_bundle(demo_bundle_path()).provenance
    config = TrainConfig(Path("unused"), Path("unused"))
    described = {"wearer": config.wearer, "first_seed": config.first_seed}
    described["trembling_every"] = config.trembling_every
    assert dict(provenance.recipe) == asdict(DEMO_RECIPE) | described
    assert (provenance.people, provenance.minutes) == (config.people, config.people * config.seconds / 60.0)
