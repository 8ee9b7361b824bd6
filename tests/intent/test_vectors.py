import numpy as np
import pytest

from hilbridge.intent.bundle import demo_bundle_path, load_bundle
from hilbridge.intent.vectors import MAX_DIFFERENCE, WINDOWS, drawn_stream, largest_difference
from tests.intent.test_bundle import parts, refused, write

BLOCKS = ("input_weight", "input_bias", "hidden_weight", "hidden_bias")


def exchanged(tensor, one, other):
    """The tensor with two of its three GRU blocks exchanged."""
    blocks = np.split(tensor, 3)
    blocks[one], blocks[other] = blocks[other], blocks[one]
    return np.concatenate(blocks)


def test_the_shipped_bundle_gives_what_torch_gave():
    bundle = load_bundle(demo_bundle_path())
    assert bundle.vectors.logits.shape == (WINDOWS, 21)
    found = largest_difference(bundle.weights, bundle.mean, bundle.std, bundle.window_steps, bundle.vectors)
    assert found < MAX_DIFFERENCE / 100


def test_the_stream_is_the_same_every_time_and_loses_each_modality():
    mean, std = np.zeros(55, dtype=np.float32), np.ones(55, dtype=np.float32)
    values, valid = drawn_stream(mean, std, 50)
    again, _ = drawn_stream(mean, std, 50)
    assert (values == again).all()
    assert not valid.all(axis=0).any()


@pytest.mark.parametrize(("one", "other"), [(0, 1), (0, 2), (1, 2)])
def test_exchanged_gates_are_found(tmp_path, one, other):
    tensors, metadata = parts()
    for names in [(name,) for name in BLOCKS] + [BLOCKS]:
        changed = {name: exchanged(tensors[name], one, other) for name in names}
        refused(write(tmp_path / "b.safetensors", {**tensors, **changed}, metadata), "other logits", "exchanged")


@pytest.mark.parametrize(
    "name", ["fc_weight", "fc_bias", "input_weight", "hidden_weight", "head_weight", "head_bias", "mean", "std"]
)
def test_rows_in_another_order_are_found(tmp_path, name):
    tensors, metadata = parts()
    changed = {name: np.roll(tensors[name], 1, axis=0)}
    refused(write(tmp_path / "b.safetensors", {**tensors, **changed}, metadata), "other logits")


def test_vectors_that_are_absent_cut_or_no_numbers_deny(tmp_path):
    tensors, metadata = parts()
    for name in ("vector_values", "vector_valid", "vector_logits"):
        without = {key: tensor for key, tensor in tensors.items() if key != name}
        refused(write(tmp_path / "b", without, metadata), name, "missing")
        refused(write(tmp_path / "b", {**tensors, name: tensors[name][1:]}, metadata), name, "shape")
        wrong = tensors[name].copy()
        wrong[0, 0] = np.nan
        refused(write(tmp_path / "b", {**tensors, name: wrong}, metadata), name, "not finite")
    refused(write(tmp_path / "b", tensors, {**metadata, "format": 1}), "format 1")
