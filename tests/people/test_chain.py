"""From labelled recordings to a bundle that is certified and knows its wearer: the whole way, with small figures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

from hilbridge.errors import InputError
from hilbridge.intent.bundle import load_bundle
from hilbridge.intent.provenance import Origin, refusal
from hilbridge.learning.certificate.certify_bundle import CertifyConfig
from hilbridge.people.adapt import adapt
from hilbridge.people.certify import certify_on_people
from hilbridge.people.load import load_people
from hilbridge.people.simulate import simulate
from hilbridge.people.train import PeopleConfig, train_on_people
from hilbridge.wearer.timeline import DEMO
from tests.people.before_a_camera import SECONDS, TINY, bundle_of_one_wearer, of_camera


def made(folder: Path, people: int, seed: int) -> Path:
    simulate(folder, people, SECONDS, DEMO, seed, lambda: None)
    return folder


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory):
    root = tmp_path_factory.mktemp("people")
    data = made(root / "train", 6, 40_000)
    config = PeopleConfig(
        (data,), root / "b.safetensors", root / "work", root / "report", recipe=TINY, precision=0.3, folds=3
    )
    said: list[str] = []
    return root, config, train_on_people(config, said.append), said


def test_training_on_people_writes_a_bundle_a_report_and_a_card(trained) -> None:
    _, _, result, said = trained
    bundle = load_bundle(result.bundle)
    record = bundle.provenance
    assert record is not None
    assert bundle.doubt is None
    assert (record.origin, record.people, len(record.who), len(record.data)) == (Origin.SIMULATED, 6, 6, 6)
    assert record.minutes == pytest.approx(6 * SECONDS / 60.0, abs=0.05)
    assert bundle.curve
    assert "simulated" in (refusal(record, bundle.doubt, 0.9) or "")
    page = result.report.read_text()
    for title in (
        "E1: calibration",
        "E2: modalities lost",
        "E3: act-only",
        "E4: runtime",
        "E5: closed loop",
        "By person",
    ):
        assert title in page
    card = result.card.read_text()
    assert "6 people" in card
    assert "for a physical bus: trained on simulated people" in card
    assert any("6 people, 6 sessions" in line for line in said)


def test_an_interrupted_training_goes_on_and_another_set_of_files_begins_anew(trained) -> None:
    root, config, result, _ = trained
    again = train_on_people(replace(config, out=root / "again.safetensors"))
    first, second = load_bundle(result.bundle), load_bundle(again.bundle)
    assert (first.weights.hidden_weight == second.weights.hidden_weight).all()
    assert first.curve == second.curve
    folds = len(list((root / "work").glob("fold-*.npz")))
    assert folds == 3


def test_the_bundle_is_certified_on_others_and_refused_on_its_own_people(trained) -> None:
    root, config, result, _ = trained
    others = made(root / "others", 8, 41_000)
    asked = CertifyConfig(result.bundle, precision=0.2, delta=0.3, write=root / "certified.safetensors")
    done = certify_on_people(asked, (others,), lambda line: None)
    assert done.certificate.clusters == 8
    if done.written is not None:
        promise = load_bundle(done.written).provenance.certificate
        assert (promise.precision, promise.origin, len(promise.data)) == (0.2, Origin.SIMULATED, 8)
        assert "average person" in promise.estimand
    with pytest.raises(InputError, match="the bundle was trained on S-40000"):
        certify_on_people(asked, config.data, lambda line: None)


def test_folds_and_certificates_on_a_cluster_are_the_same(trained) -> None:
    pytest.importorskip("distributed")
    root, config, result, _ = trained
    there = replace(config, out=root / "dask", work=root / "elsewhere", jobs=2, cluster="dask")
    one, other = load_bundle(result.bundle), load_bundle(train_on_people(there).bundle)
    assert one.curve == other.curve
    assert (one.weights.hidden_weight == other.weights.hidden_weight).all()
    data = (made(root / "few", 4, 41_500),)
    asked = CertifyConfig(result.bundle, precision=0.2, delta=0.3)
    answers = [certify_on_people(each, data, lambda line: None) for each in (asked, replace(asked, jobs=2))]
    assert answers[0].lines() == answers[1].lines()


def test_adapting_only_ever_makes_more_careful(trained) -> None:
    root, config, result, _ = trained
    bundle = load_bundle(result.bundle)
    one = adapt(result.bundle, (config.data[0] / "S-40001",), root / "one.safetensors")
    after = load_bundle(root / "one.safetensors")
    assert one.used <= 0.0
    assert after.thresholds == bundle.thresholds
    assert after.doubt is None
    for condition, own in bundle.maps.by_condition.items():
        assert np.all(np.array(after.maps.by_condition[condition].y) <= np.array(own.y) + 1e-12)
    with pytest.raises(InputError, match="sessions of 6 people"):
        adapt(result.bundle, config.data, root / "many.safetensors")


def test_recordings_of_a_camera_are_of_people_and_sessions_of_one_person_belong_together(trained) -> None:
    root, config, _, _ = trained
    folder = root / "camera"
    for place, (seed, person) in enumerate(((40_000, "P-1"), (40_001, "P-1"), (40_002, "P-2"), (40_003, "P-3"))):
        of_camera(config.data[0] / f"S-{seed}" / "recording.mcap", folder / f"run-{place}", person)
    said: list[str] = []
    of_camera(config.data[0] / "S-40004" / "recording.mcap", folder / "run-9", "P-4", labels=False)
    people = load_people((folder,), said.append)
    assert people.names == ("P-1", "P-2", "P-3")
    assert people.origin is Origin.RECORDED
    assert len(people.sessions) == 4
    assert any("no labels, left out" in line for line in said)
    known = people.stream.known
    assert known.sum() == pytest.approx(4 * SECONDS * 25, abs=8)


def test_labels_beside_a_recording_do_as_well(trained, tmp_path: Path) -> None:
    _, config, _, _ = trained
    source = config.data[0] / "S-40002"
    target = of_camera(source / "recording.mcap", tmp_path / "run", "P-5", labels=False)
    (target / "recording.labels.csv").write_bytes((source / "recording.labels.csv").read_bytes())
    from hilbridge.people.recordings import recorded_session

    inside, beside = recorded_session(source), recorded_session(target)
    assert inside is not None
    assert beside is not None
    assert (inside.stream.event == beside.stream.event).all()
    assert (inside.stream.known == beside.stream.known).all()
    assert (inside.stream.values == beside.stream.values).all()


def test_what_cannot_be_trained_on_is_one_line(trained, tmp_path: Path) -> None:
    _, config, _, _ = trained
    with pytest.raises(InputError, match="no such file or folder"):
        load_people((tmp_path / "absent",))
    with pytest.raises(InputError, match="neither labelled recordings"):
        load_people((tmp_path,))
    with pytest.raises(InputError, match="of 1 people; at least 3"):
        load_people((config.data[0] / "S-40000",))
    with pytest.raises(InputError, match="is there twice"):
        load_people((config.data[0], config.data[0] / "S-40000"))
    with pytest.raises(InputError, match="--recipe worst: must be one of best, paper"):
        train_on_people(replace(config, recipe_name="worst"))
    with pytest.raises(InputError, match="holds a recording already"):
        simulate(config.data[0], 1, SECONDS, DEMO, 40_000, lambda: None)


def test_people_before_a_camera_end_in_a_bundle_that_may_act(tmp_path: Path) -> None:
    """The whole way: twelve people to train on, others to certify, one wearer, and nothing left to refuse."""
    config, certified, mine_path = bundle_of_one_wearer(tmp_path)
    bundle = load_bundle(config.out)
    assert refusal(bundle.provenance, bundle.doubt, bundle.thresholds.tau_on) == "its threshold is not certified"
    assert load_bundle(certified).provenance.certificate is not None
    mine = load_bundle(mine_path)
    assert refusal(mine.provenance, mine.doubt, mine.thresholds.tau_on) is None
    assert mine.provenance.figures["adapted_to_one_wearer"]["files"] == 1
    lower = mine.provenance.certificate.tau_on - 0.01
    assert "below" in (refusal(mine.provenance, mine.doubt, lower) or "")
