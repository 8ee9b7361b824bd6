from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("sklearn")
pytest.importorskip("torch")

from hilbridge.intent.bundle import BundleError, Replayed, demo_bundle_path, load_bundle
from hilbridge.learning.certificate.certify import Method
from hilbridge.learning.certificate.certify_bundle import (
    GATE_TAUS,
    CertifyConfig,
    certify_bundle,
    gate_counts,
    method_named,
    start_of,
)
from hilbridge.learning.data.synthetic import record_people
from hilbridge.learning.training.gate_fit import GATE
from hilbridge.learning.training.replay import watch, window_masks
from hilbridge.verbs import VERBS
from hilbridge.wearer.timeline import DEMO


def test_a_bundle_is_certified_through_the_gate_and_written(tmp_path):
    config = CertifyConfig(
        demo_bundle_path(),
        precision=0.3,
        delta=0.3,
        method=Method.CLUSTER_T,
        people=12,
        seconds=16.0,
        write=tmp_path / "certified.safetensors",
    )
    result = certify_bundle(config)
    assert result.certificate.clusters == 12
    assert result.certificate.tau_on in GATE_TAUS
    assert result.written is not None
    bundle = load_bundle(result.written)
    assert bundle.thresholds.tau_on == result.certificate.tau_on
    assert bundle.provenance.certificate.method == "cluster_t"
    text = " ".join(result.lines())
    assert "assumes" in text
    assert "epsilon" in text


def test_too_few_people_are_not_certified_and_nothing_is_written(tmp_path):
    out = tmp_path / "none.safetensors"
    result = certify_bundle(CertifyConfig(demo_bundle_path(), people=5, seconds=8.0, write=out))
    assert result.certificate.tau_on is None
    assert not out.exists()
    assert "not certified" in result.lines()[0]


def test_wrong_settings_are_named(tmp_path):
    with pytest.raises(BundleError, match="absent"):
        certify_bundle(CertifyConfig(tmp_path / "absent"))
    with pytest.raises(ValueError, match="wearer 'x'"):
        certify_bundle(CertifyConfig(demo_bundle_path(), wearer="x"))
    with pytest.raises(ValueError, match="comparison only"):
        certify_bundle(CertifyConfig(demo_bundle_path(), method=Method.CLOPPER_PEARSON, write=tmp_path / "w"))


def test_silence_never_acts():
    people = record_people([70], DEMO, 4.0)
    silence = watch(np.full((100, len(VERBS)), np.nan), window_masks(people), people.subject, {}, GATE)
    counts = gate_counts(GATE, silence, people)
    assert counts.acting.sum() == 0
    assert np.array_equal(counts.total, [100])


def test_a_handful_who_do_well_at_a_strict_threshold_choose_no_start():
    points = [(0.5, 12, 0.72, 0.13), (0.6, 12, 0.71, 0.16), (0.8, 7, 0.86, 0.24)]
    curve = tuple(Replayed(tau, mean, 0.1, people, mean, spread) for tau, people, mean, spread in points)
    bundle = replace(load_bundle(demo_bundle_path()), curve=curve)
    assert start_of(bundle, 0.5) == 0.5
    assert start_of(bundle, 0.7) == 0.8  # nothing else has a chance
    assert start_of(replace(bundle, curve=()), 0.5) == GATE_TAUS[0]


def test_an_unknown_method_is_refused_with_those_there_are():
    assert method_named("cluster_t") is Method.CLUSTER_T
    with pytest.raises(
        ValueError, match="method 'foo': must be one of betting, betting_pooled, cluster_t, clopper_pearson"
    ):
        method_named("foo")
