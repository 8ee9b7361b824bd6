"""The ONNX file gives the logits of our own engine, whatever is masked, and says what it is and is not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

onnxruntime = pytest.importorskip("onnxruntime")
onnx = pytest.importorskip("onnx")

from hilbridge.bench_prediction import of_size  # noqa: E402
from hilbridge.cli import app  # noqa: E402
from hilbridge.exchange.onnx_model import export_onnx  # noqa: E402
from hilbridge.features.layout import D  # noqa: E402
from hilbridge.intent.bundle import Bundle, demo_bundle_path, load_bundle  # noqa: E402
from hilbridge.intent.gru import full_window  # noqa: E402
from hilbridge.intent.standardise import standardise  # noqa: E402
from hilbridge.verbs import Vocabulary  # noqa: E402


def five_verbs(bundle: Bundle) -> Bundle:
    head = {"head_weight": bundle.weights.head_weight[:5], "head_bias": bundle.weights.head_bias[:5]}
    names = Vocabulary(("Take", "Put", "Stir", "Hold Cup", "other"), frozenset({3}))
    return replace(bundle, weights=replace(bundle.weights, **head), vocabulary=names)


@pytest.mark.parametrize("size", [None, 24, 256])
def test_its_logits_are_ours(size: int | None, tmp_path: Path) -> None:
    bundle = load_bundle(demo_bundle_path())
    bundle = five_verbs(bundle) if size == 24 else bundle
    bundle = bundle if size is None else of_size(bundle, size)
    session = onnxruntime.InferenceSession(export_onnx(bundle, tmp_path / "b.onnx"), providers=["CPUExecutionProvider"])
    rng = np.random.default_rng(7)
    for share in (1.0, 0.7, 0.2, 0.0):
        values = rng.normal(0.5, 3.0, (bundle.window_steps, D)).astype(np.float32)
        valid = rng.random((bundle.window_steps, 3)) < share
        (logits,) = session.run(None, {"values": values, "valid": valid})
        x = standardise(values, valid, bundle.mean, bundle.std)
        assert logits == pytest.approx(full_window(bundle.weights, x, valid.any(axis=1)), abs=1e-5)


def test_it_names_its_bundle_and_says_that_nothing_may_act_on_it(tmp_path: Path) -> None:
    bundle = load_bundle(demo_bundle_path())
    said = {one.key: one.value for one in onnx.load(export_onnx(bundle, tmp_path / "b.onnx")).metadata_props}
    assert said["hilbridge.bundle_id"] == f"{bundle.bundle_id:#06x}"
    assert tuple(json.loads(said["hilbridge.verbs"])) == bundle.vocabulary.names
    assert "nothing may act" in said["hilbridge.note"]


def test_the_command_writes_it_and_replaces_nothing_unasked(tmp_path: Path) -> None:
    out = str(tmp_path / "b.onnx")
    first = CliRunner().invoke(app, ["export-onnx", "--out", out])
    assert first.exit_code == 0
    assert first.stdout.startswith("network of bundle 0x")
    assert CliRunner().invoke(app, ["export-onnx", "--out", out]).exit_code != 0
    assert CliRunner().invoke(app, ["export-onnx", "--out", out, "--force"]).exit_code == 0
