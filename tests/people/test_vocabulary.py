"""People with verbs of their own, the whole way: labels, training, bundle, gate, bus, card, certificate, recording."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

from hilbridge.config import Config, GateSection, ModelConfig
from hilbridge.core.bridge import BridgeConfig
from hilbridge.errors import InputError
from hilbridge.features.assembler import FeatureAssembler
from hilbridge.features.layout import STEP_NS
from hilbridge.intent.bundle import BundleError, load_bundle, save_bundle
from hilbridge.intent.card import card_of
from hilbridge.labels.store import beside, labels_of, put_labels
from hilbridge.learning.certificate.certify_bundle import CertifyConfig
from hilbridge.limits import FREEZE_LIMIT_MS, MS, SENSOR_TIMEOUT_MS
from hilbridge.people.adapt import adapt
from hilbridge.people.certify import certify_on_people
from hilbridge.people.load import load_people
from hilbridge.people.simulate import simulate
from hilbridge.people.train import PeopleConfig, train_on_people
from hilbridge.records import Action, HoldReason
from hilbridge.rows import belief_row
from hilbridge.runtime.assemble import assemble_node, read_parts
from hilbridge.runtime.health import SensorSeen
from hilbridge.runtime.provenance import bundle_row, config_row
from hilbridge.verbs import Vocabulary
from hilbridge.wearer.person import Wearer
from hilbridge.wearer.timeline import DEMO
from hilbridge.wire.keys import DEMO_KEY
from tests.people.before_a_camera import LEARNS

NAMES = ("Take", "Put", "Stir", "Hold Cup", "other")
FILE = "verb,assisted\ntake,yes\nPut,yes\nStir,yes\nHold Cup,no\nother,yes\n"
THEIRS = {"Take": "Take", "Put": "Put", "Open": "Stir", "Cut": "Hold Cup", "none": "none"}


def people(folder: Path, count: int, seed: int) -> Path:
    """Simulated people whose observer writes down other verbs than the default's."""
    folder.mkdir()
    (folder / "verbs.csv").write_text(FILE, encoding="utf-8")
    for made in simulate(folder, count, 24.0, DEMO, seed, lambda: None):
        put_labels(made, [replace(label, verb=THEIRS.get(label.verb, "other")) for label in labels_of(made)])
    return folder


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, PeopleConfig]:
    root = tmp_path_factory.mktemp("verbs")
    data = people(root / "train", 6, 44_000)
    config = PeopleConfig((data,), root / "b", root / "work", root / "report", recipe=LEARNS, precision=0.2, folds=2)
    train_on_people(config)
    return root, config


def test_the_bundle_keeps_names_and_what_may_be_assisted_and_says_so(trained) -> None:
    root, config = trained
    bundle = load_bundle(config.out)
    assert bundle.vocabulary == Vocabulary(NAMES, frozenset({3, 4}))
    assert bundle.weights.head_weight.shape[0] == bundle.vectors.logits.shape[1] == 5
    assert bundle.doubt is None
    assert any(name.endswith("/verbs.csv") for name in bundle.provenance.data)
    card = (root / "report" / "model_card.md").read_text()
    assert "5 verbs: Take, Put, Stir, Hold Cup, other; never assisted: Hold Cup, other" in card
    assert card_of(bundle).count("Stir") == 1
    assert load_bundle(save_bundle(bundle, root / "again")).vocabulary == bundle.vocabulary


def test_the_bridge_acts_on_what_the_bus_can_name_and_records_its_words(trained) -> None:
    _, config = trained
    asked = Config(model=ModelConfig(bundle=str(config.out)), gate=GateSection(tau_on=0.1, tau_off=0.05))
    parts = read_parts(asked)
    assert parts.gate.vocabulary.assisted == ("Take", "Put")  # the shipped value table has no Stir
    assert parts.bundle.vocabulary.lacking(parts.codec.verbs) == ("Stir",)
    assert bundle_row(parts, 0).verbs == NAMES
    assert config_row({}, parts, 0).settings["gate_in_force"]["never_assisted"] == ["Stir", "Hold Cup", "other"]
    node = assemble_node(parts, DEMO_KEY, lambda: 1, BridgeConfig(), lambda now_ns, text: None)
    node.bridge.veto = lambda now_ns: HoldReason.NONE  # a device that would take everything
    wearer, assembler, seen = Wearer(44_100, width_px=96, height_px=72), FeatureAssembler(), set()
    reasons: Counter[HoldReason] = Counter()
    for step in range(40 * 25):
        now_ns = step * STEP_NS
        vector = assembler.update(wearer.frame(now_ns), wearer.gaze(now_ns), wearer.hands(now_ns), now_ns)
        camera = SensorSeen("camera", True, now_ns, now_ns, SENSOR_TIMEOUT_MS * MS, FREEZE_LIMIT_MS * MS)
        tick = node.tick(vector, (camera,), now_ns + 5 * MS)
        reasons[tick.decision.reason] += 1
        if tick.belief is not None:
            assert len(tick.belief.probabilities) == 5
            row = belief_row(tick.belief, now_ns, node.decider.gate_config.vocabulary)
            assert row.verb == tick.row.top_verb
        if tick.decision.action is Action.ACT:
            seen.add(tick.row.verb)
            assert node.bridge.command.verb == tick.row.verb
    assert seen, reasons
    assert seen <= {"Take", "Put"}


def test_certificate_and_adaptation_meet_people_with_verbs_it_does_not_know(trained, tmp_path: Path) -> None:
    _, config = trained
    simulate(tmp_path / "others", 4, 24.0, DEMO, 44_200, lambda: None)  # all 21 verbs, no verbs.csv
    met = load_people((tmp_path / "others",), met=Vocabulary(("Take", "Put"), frozenset()))
    assert set(np.unique(met.stream.current)) == {-1, 0, 1, 2}  # 2: what nobody can predict
    asked = CertifyConfig(config.out, precision=0.1, delta=0.3)
    assert certify_on_people(asked, (tmp_path / "others",), lambda line: None).certificate.clusters == 4
    done = adapt(config.out, (tmp_path / "others" / "S-44200",), tmp_path / "mine")
    assert load_bundle(done.written).vocabulary.names == NAMES


def test_what_is_no_vocabulary_is_one_line(trained, tmp_path: Path) -> None:
    _, config = trained
    data = people(tmp_path / "few", 3, 44_300)
    for text, said in (
        ("verb\nTake\n", "write the header verb,assisted"),
        ("verb,assisted\nTake,perhaps\n", "verbs.csv:2: assisted is 'perhaps'; write yes or no"),
        ("verb,assisted\nTake,yes\ntake,no\n", "verb 'Take' is there twice"),
        ("verb,assisted\nTake,yes\n", "a vocabulary has 2 to 64"),
        ("verb,assisted\nTake,yes\nnone,no\n", "'none' is no name of a verb"),
        ("verb,assisted\nTake,yes\nPut,yes\n", "verb '[^']+' is not of the vocabulary .Take, Put.; add it"),
    ):
        (data / "verbs.csv").write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=said):
            load_people((data,))
    with pytest.raises(InputError, match=r"its vocabulary .* is another than that of"):
        load_people((config.data[0], people(tmp_path / "x", 3, 44_400), tmp_path))
    (data / "verbs.csv").write_text(FILE, encoding="utf-8")
    labels = beside(data / "S-44300")
    labels.write_text("start_ms,end_ms,verb,source\n0,900,Juggle,me\n", encoding="utf-8")
    from hilbridge.labels.table import read_csv

    with pytest.raises(InputError, match=r"'Juggle' is no verb; .*\(a data set with others names them in verbs.csv\)"):
        read_csv(labels)


def test_a_bundle_whose_vocabulary_was_edited_is_refused(trained, tmp_path: Path) -> None:
    from tests.intent.test_bundle import stored, write

    _, config = trained
    tensors, metadata = stored(config.out)
    for change in ({"assisted": ["Take", "other"]}, {"assisted": "Take"}, {"verbs": list(NAMES[:4])}, {"format": 3}):
        with pytest.raises(BundleError):
            load_bundle(write(tmp_path / "edited", tensors, {**metadata, **change}))
    more = load_bundle(write(tmp_path / "more", tensors, {**metadata, "assisted": ["Take", "Put", "Stir", "Hold Cup"]}))
    assert "edited after it was sealed" in more.doubt
