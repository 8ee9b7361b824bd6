import numpy as np
import pytest

from hilbridge.features.layout import D
from hilbridge.intent.gru import StreamingGru, full_window

torch = pytest.importorskip("torch")
from hilbridge.learning.training.network import GruNetwork, export_weights  # noqa: E402

STEPS = 50


@pytest.fixture(scope="module")
def network():
    torch.manual_seed(3)
    return GruNetwork(dropout=0.0).eval()


def windows(rng, count):
    x = rng.normal(size=(count + STEPS - 1, D)).astype(np.float32)
    usable = rng.uniform(size=count + STEPS - 1) < 0.8
    return x, usable


def test_streaming_equals_torchs_full_window_at_every_tick(network):
    rng = np.random.default_rng(0)
    x, usable = windows(rng, 120)
    offset = rng.normal(size=21)
    engine = StreamingGru(export_weights(network, offset), STEPS)
    streamed = [engine.step(row, bool(flag)) for row, flag in zip(x, usable, strict=True)]
    assert all(out is None for out in streamed[: STEPS - 1])
    batch = np.stack([x[start : start + STEPS] for start in range(120)])
    flags = np.stack([usable[start : start + STEPS] for start in range(120)])
    with torch.inference_mode():
        expected = network(torch.from_numpy(batch), torch.from_numpy(flags)).numpy() + offset
    assert np.abs(np.stack(streamed[STEPS - 1 :]) - expected).max() < 1e-5


def test_reset_forgets_everything(network):
    rng = np.random.default_rng(1)
    x, usable = windows(rng, 1)
    engine = StreamingGru(export_weights(network, np.zeros(21)), STEPS)
    for row in rng.normal(size=(70, D)).astype(np.float32):
        engine.step(row, True)
    engine.reset()
    outs = [engine.step(row, bool(flag)) for row, flag in zip(x, usable, strict=True)]
    assert outs[:-1] == [None] * (STEPS - 1)
    assert outs[-1] == pytest.approx(full_window(export_weights(network, np.zeros(21)), x, usable), abs=1e-6)
    assert engine.usable_steps() == usable.sum()


def test_a_window_without_any_usable_step_is_finite(network):
    engine = StreamingGru(export_weights(network, np.zeros(21)), STEPS)
    out = None
    for _ in range(STEPS):
        out = engine.step(np.zeros(D, dtype=np.float32), False)
    assert out is not None
    assert np.isfinite(out).all()
