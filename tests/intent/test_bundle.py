import contextlib
import json
import struct
from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from safetensors.numpy import load, save

from hilbridge.intent.bundle import (
    METADATA_KEY,
    BundleError,
    Replayed,
    demo_bundle_path,
    load_bundle,
    save_bundle,
    seal_of,
)
from hilbridge.intent.provenance import LEAST_PEOPLE, Origin, Promise, Provenance, refusal


def parts():
    return stored(demo_bundle_path())


def stored(path):
    data = path.read_bytes()
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
    assert set(bundle.temperatures) == set(range(1, 8))
    assert set(bundle.maps.by_condition) >= set(range(1, 8))
    assert bundle.provenance.origin is Origin.SIMULATED
    assert bundle.doubt is None


def test_what_is_saved_is_what_is_loaded(tmp_path):
    bundle = load_bundle(demo_bundle_path())
    again = load_bundle(save_bundle(bundle, tmp_path / "deep" / "b.safetensors"))
    assert (again.weights.hidden_weight == bundle.weights.hidden_weight).all()
    assert (again.temperatures, again.maps, again.curve) == (bundle.temperatures, bundle.maps, bundle.curve)
    assert again.provenance == bundle.provenance
    assert again.thresholds == bundle.thresholds
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["b.safetensors"]


def test_maps_and_curves_that_are_none_are_refused(tmp_path):
    tensors, metadata = parts()
    for wrong in ({"7": [[0, 1], [0, 1]]}, {"9": 3}, {**metadata["maps"], "900": [[0, 1], [0, 1]]}, ["7"]):
        refused(write(tmp_path / "c", tensors, {**metadata, "maps": wrong}))
    for wrong in (
        [[0.5, 2.0, 0.1, 3, 0.5, 0.1]],
        [[0.5]],
        [[0.6, 0.5, 0.1, 3, 0.5, 0.1], [0.5, 0.5, 0.1, 3, 0.5, 0.1]],
        3,
    ):
        refused(write(tmp_path / "d", tensors, {**metadata, "curve": wrong}))


def test_a_precision_asks_for_the_lowest_threshold_from_which_on_it_is_reached():
    points = [(0.5, 0.7), (0.6, 0.85), (0.7, 0.78), (0.8, 0.81), (0.9, 0.93)]
    curve = tuple(Replayed(tau, precision, 0.1, 9, precision, 0.1) for tau, precision in points)
    bundle = replace(load_bundle(demo_bundle_path()), curve=curve)
    assert bundle.tau_for(0.8) == 0.8
    assert bundle.tau_for(0.7) == 0.5
    assert bundle.tau_for(0.95) is None


AFFIRMED = Provenance(
    Origin.RECORDED,
    LEAST_PEOPLE,
    60.0,
    {"name": "best"},
    tuple(f"person {number}" for number in range(LEAST_PEOPLE)),
    {"P-01.mcap": "a" * 64},
    certificate=Promise(0.7, 0.8, 0.1, "betting", "precision", 30, Origin.RECORDED, {"P-90.mcap": "b" * 64}),
)


def of_people(tmp_path):
    return save_bundle(replace(load_bundle(demo_bundle_path()), provenance=AFFIRMED), tmp_path / "people.safetensors")


def judged(path, tau_on=0.75):
    bundle = load_bundle(path)
    return refusal(bundle.provenance, bundle.doubt, tau_on)


def test_h1_a_bundle_of_certified_people_may_act_with_its_threshold_and_above(tmp_path):
    path = of_people(tmp_path)
    assert judged(path) is None
    assert judged(path, 0.7) is None
    assert "below 0.7" in judged(path, 0.69)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"origin": Origin.SIMULATED}, "simulated"),
        ({"people": LEAST_PEOPLE - 1, "who": AFFIRMED.who[1:]}, "at least"),
        ({"certificate": None}, "not certified"),
        ({"certificate": replace(AFFIRMED.certificate, origin=Origin.SIMULATED)}, "certified on simulated"),
    ],
)
def test_h1_each_statement_of_the_record_is_needed(changed, why):
    assert why in refusal(replace(AFFIRMED, **changed), None, 0.8)


@pytest.mark.parametrize("name", ["tau_on", "precision", "delta"])
@pytest.mark.parametrize("value", [0.0, 1.0, 1.5, -0.1, float("nan"), float("inf"), "0.8x", None, []])
def test_h1_a_certificate_promises_a_share_and_nothing_else(tmp_path, name, value):
    tensors, metadata = stored(of_people(tmp_path))
    metadata["provenance"]["certificate"][name] = value
    metadata["seal"] = seal_of(tensors, metadata)  # a liar seals it anew
    assert "cannot be read" in judged(write(tmp_path / "b", tensors, metadata))


def test_h1_a_bench_may_do_without_a_certificate_and_without_nothing_else():
    bare = replace(AFFIRMED, certificate=None)
    assert refusal(bare, None, 0.8, uncertified=True) is None
    assert refusal(replace(bare, people=3, who=bare.who[:3]), None, 0.8, uncertified=True) is not None
    assert refusal(replace(bare, origin=Origin.SIMULATED), None, 0.8, uncertified=True) is not None
    assert refusal(bare, "edited", 0.8, uncertified=True) == "edited"
    assert refusal(None, None, 0.8, uncertified=True) is not None


@pytest.mark.parametrize("raw", [None, 3, "recorded people", [], {}, {"origin": "recorded people"}])
def test_h1_an_absent_or_unreadable_record_predicts_but_may_not_act(tmp_path, raw):
    tensors, metadata = parts()
    path = write(tmp_path / "b", tensors, {**metadata, "provenance": raw})
    assert load_bundle(path).window_steps == 50
    assert judged(path) is not None


def edited(value):
    """Something else of the same kind."""
    if isinstance(value, dict):
        name = sorted(value)[0] if value else None
        return {**value, name: edited(value[name])} if name is not None else {"more": 1}
    if isinstance(value, list):
        return [edited(value[0]), *value[1:]] if value else [1]
    if isinstance(value, bool) or value is None:
        return 1
    return value * 0.99 + 0.001 if isinstance(value, int | float) else f"{value}x"


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_h1_no_edit_of_header_or_tensors_may_act(tmp_path, data):
    path = of_people(tmp_path)
    tensors, metadata = stored(path)
    inside = [f"provenance.{name}" for name in metadata["provenance"]]
    place = data.draw(st.sampled_from(["tensor", *sorted(metadata), *inside]))
    if place == "tensor":
        name = data.draw(st.sampled_from(sorted(tensors)))
        array = tensors[name].copy()
        array.flat[data.draw(st.integers(0, array.size - 1))] += np.float32(1e-3)
        tensors[name] = array
    elif place.startswith("provenance."):
        inner = place.partition(".")[2]
        metadata["provenance"][inner] = edited(metadata["provenance"][inner])
    else:
        metadata[place] = edited(metadata[place])
    write(path, tensors, metadata)
    try:
        assert judged(path) is not None
    except BundleError:
        pass  # refused altogether


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    raw=st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=12),
        lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.sampled_from(sorted(asdict(AFFIRMED))), inner),
        max_leaves=8,
    )
)
def test_h1_no_invented_provenance_may_act(tmp_path, raw):
    tensors, metadata = parts()
    assert judged(write(tmp_path / "b", tensors, {**metadata, "provenance": raw})) is not None


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
        {"temperatures": {}},
        {"temperatures": {"7": 1.0}},
        {"maps": {}},
        {"curve": None},
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
