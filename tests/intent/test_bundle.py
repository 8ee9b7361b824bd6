import contextlib
import json
import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from safetensors.numpy import load, save

from hilbridge.intent.bundle import METADATA_KEY, BundleError, demo_bundle_path, load_bundle, save_bundle


def parts():
    data = demo_bundle_path().read_bytes()
    (length,) = struct.unpack_from("<Q", data)
    return load(data), json.loads(json.loads(data[8 : 8 + length])["__metadata__"][METADATA_KEY])


def write(path, tensors, metadata):
    text = metadata if isinstance(metadata, str) else json.dumps(metadata)
    path.write_bytes(save(tensors, metadata={METADATA_KEY: text}))
    return path


def refused(path, *words):
    with pytest.raises(BundleError) as caught:
        load_bundle(path)
    message = str(caught.value)
    assert str(path) in message
    assert "hilbridge train" in message
    assert "\n" not in message
    for word in words:
        assert word in message


def test_the_demo_bundle_loads_and_is_small():
    bundle = load_bundle(demo_bundle_path())
    assert demo_bundle_path().stat().st_size < 4 << 20
    assert bundle.window_steps == 50
    assert 0 < bundle.bundle_id < 1 << 16
    assert bundle.thresholds.tau_off < bundle.thresholds.tau_on
    assert set(bundle.calibration.temperatures) == set(range(1, 8))
    assert "simulated wearer" in bundle.provenance["trained_on"]


def test_what_is_saved_is_what_is_loaded(tmp_path):
    bundle = load_bundle(demo_bundle_path())
    again = load_bundle(save_bundle(bundle, tmp_path / "deep" / "b.safetensors"))
    assert (again.weights.hidden_weight == bundle.weights.hidden_weight).all()
    assert again.calibration == bundle.calibration
    assert again.thresholds == bundle.thresholds
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["b.safetensors"]


def test_a_curve_for_each_set_of_modalities_is_kept_and_older_bundles_have_one_for_all(tmp_path):
    bundle = load_bundle(demo_bundle_path())
    assert set(bundle.calibration.isotonic) == set(range(1, 8))
    curves = {mask: ((0.0, 1.0), (0.0, 0.1 * mask)) for mask in range(1, 8)}
    renewed = replace(bundle, calibration=replace(bundle.calibration, isotonic=curves))
    path = save_bundle(renewed, tmp_path / "b.safetensors")
    assert load_bundle(path).calibration.isotonic == curves
    tensors, metadata = parts()
    del metadata["calibration"]["isotonic"]
    metadata["calibration"] |= {"isotonic_x": [0.0, 1.0], "isotonic_y": [0.0, 0.9]}
    assert load_bundle(write(tmp_path / "old", tensors, metadata)).calibration.isotonic == {7: ((0.0, 1.0), (0.0, 0.9))}
    for wrong in ({"9": [[0, 1], [0, 1]]}, {"7": [[0, 1]]}, {"7": 3}, ["7"]):
        metadata["calibration"]["isotonic"] = wrong
        refused(write(tmp_path / "c", tensors, metadata), "unusable bundle")


def test_absent_folder_empty_and_foreign_files_are_refused(tmp_path):
    refused(tmp_path / "absent.safetensors", "cannot be read")
    refused(tmp_path, "not a file")
    for content in (b"", b"\x00" * 7, b"hello, this is no bundle at all", b"\xff" * 4096):
        path = tmp_path / "foreign"
        path.write_bytes(content)
        refused(path, "truncated")


def test_every_truncation_is_refused(tmp_path):
    data = demo_bundle_path().read_bytes()
    path = tmp_path / "cut.safetensors"
    for length in (1, 8, 100, 2000, len(data) // 2, len(data) - 1):
        path.write_bytes(data[:length])
        refused(path)


def test_another_layout_other_verbs_and_other_formats_are_refused(tmp_path):
    tensors, metadata = parts()
    refused(write(tmp_path / "a", tensors, {**metadata, "layout_hash": "0" * 64}), "layout")
    refused(write(tmp_path / "b", tensors, {**metadata, "verbs": ["Take"]}), "verbs")
    refused(write(tmp_path / "c", tensors, {**metadata, "format": 99}), "format")


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30])
def test_numbers_that_are_none_are_refused(tmp_path, value):
    tensors, metadata = parts()
    tensors["hidden_bias"] = tensors["hidden_bias"].copy()
    tensors["hidden_bias"][3] = value
    refused(write(tmp_path / "nan", tensors, metadata), "hidden_bias")


def test_hostile_tensors_are_refused(tmp_path):
    tensors, metadata = parts()
    refused(write(tmp_path / "a", {k: v for k, v in tensors.items() if k != "std"}, metadata), "std")
    refused(write(tmp_path / "b", {**tensors, "std": np.zeros_like(tensors["std"])}, metadata), "standard deviation")
    refused(write(tmp_path / "c", {**tensors, "head_weight": tensors["head_weight"].T.copy()}, metadata), "shape")
    refused(write(tmp_path / "d", {**tensors, "mean": tensors["mean"].astype(np.float64)}, metadata), "mean")
    refused(write(tmp_path / "e", {**tensors, "fc_bias": np.zeros((), dtype=np.float32)}, metadata))


@pytest.mark.parametrize(
    "change",
    [
        {"thresholds": {"tau_on": 0.2, "tau_off": 0.5}},
        {"thresholds": {"tau_on": "high", "tau_off": 0.5}},
        {"thresholds": None},
        {"window_steps": 1e9},
        {"window_steps": 100_000},
        {"calibration": {}},
        {"provenance": 7},
    ],
)
def test_hostile_metadata_is_refused(tmp_path, change):
    tensors, metadata = parts()
    refused(write(tmp_path / "odd", tensors, {**metadata, **change}))


def test_a_bottomless_header_and_a_huge_file_are_refused(tmp_path):
    tensors, _ = parts()
    refused(write(tmp_path / "deep", tensors, "[" * 100_000))
    huge = tmp_path / "huge"
    with huge.open("wb") as file:
        file.truncate(65 << 20)
    refused(huge, "larger")


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(at=st.integers(0, 4_000), byte=st.integers(0, 255))
def test_a_changed_byte_in_the_header_never_gives_another_error(tmp_path, at, byte):
    data = bytearray(demo_bundle_path().read_bytes())
    data[at] = byte
    path = tmp_path / "flipped"
    path.write_bytes(data)
    with contextlib.suppress(BundleError):
        assert load_bundle(path).window_steps >= 2
