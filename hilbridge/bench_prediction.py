"""What a prediction costs, at the shipped size and at the paper's, against torch, ONNX Runtime and its own matrix product.

All are measured in one run, ten calls of each in turn: a machine whose speed drifts treats them alike, and each finds its
own weights in the caches.
"""

from __future__ import annotations

import importlib.util
import statistics
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from hilbridge.features.layout import D
from hilbridge.intent.bundle import Bundle
from hilbridge.intent.gru import Weights
from hilbridge.intent.predictor import Predictor
from hilbridge.limits import TICK_NS
from hilbridge.records import FeatureVector

PAPERS_SIZE = 256
IN_TURN = 10


class Prediction(NamedTuple):
    """Medians in ms, one thread. step: features in, calibrated estimate out, one 25 Hz step. The others have one window each
    (None where they are not installed); product: the (T, H) by (H, 3H) product of the step, alone.
    """

    step_ms: float
    product_ms: float
    torch_ms: float | None
    onnx_ms: float | None


def drawn_vectors(count: int) -> list[FeatureVector]:
    """Features of no wearer."""
    rng = np.random.default_rng(0)
    values = rng.normal(0.5, 0.2, (count, D)).astype(np.float32)
    return [FeatureVector(k * TICK_NS, k * TICK_NS, values[k], (True, True, True)) for k in range(count)]


def of_size(bundle: Bundle, hidden: int) -> Bundle:
    """The bundle with drawn weights of another size: its cost, and nothing else of it, means something."""
    rng = np.random.default_rng(1)

    def drawn(*shape: int) -> Any:
        return rng.normal(0.0, 0.1, shape).astype(np.float32)

    inner, verbs, blocks = bundle.weights.fc_bias.shape[0], len(bundle.vocabulary), 3 * hidden
    first, second = (drawn(inner, D), drawn(inner)), (drawn(blocks, inner), drawn(blocks))
    third, head = (drawn(blocks, hidden), drawn(blocks)), (drawn(verbs, hidden), drawn(verbs))
    return replace(bundle, weights=Weights(*first, *second, *third, *head))


def prediction_cost(bundle: Bundle, repeats: int = 400) -> Prediction:
    """Measure one network, everything with one thread."""
    predictor, vectors = Predictor(bundle), drawn_vectors(bundle.window_steps + IN_TURN)
    for vector in vectors:
        predictor.step(vector, vector.captured_ns)
    newest = vectors[-1]
    calls: dict[str, Callable[[], object]] = {
        "step": lambda: predictor.step(newest, newest.captured_ns),
        "product": _product(bundle),
    }
    if importlib.util.find_spec("torch"):
        calls["torch"] = _torch_window(bundle)
    if importlib.util.find_spec("onnxruntime") and importlib.util.find_spec("onnx"):
        calls["onnx"] = _onnx_window(bundle)
    taken: dict[str, list[float]] = {name: [] for name in calls}
    with _one_thread():
        for _ in range(max(1, repeats // IN_TURN)):
            for name, call in calls.items():
                for _ in range(IN_TURN):
                    begin = time.perf_counter()
                    call()
                    taken[name].append((time.perf_counter() - begin) * 1e3)
    medians = {name: statistics.median(times) for name, times in taken.items()}
    return Prediction(medians["step"], medians["product"], medians.get("torch"), medians.get("onnx"))


def _one_thread() -> AbstractContextManager[object]:
    """numpy's own threads would be measured against one thread of the others."""
    if importlib.util.find_spec("threadpoolctl") is None:
        return nullcontext()
    from threadpoolctl import threadpool_limits

    limited: AbstractContextManager[object] = threadpool_limits(1)
    return limited


def _product(bundle: Bundle) -> Callable[[], object]:
    size, rows = bundle.weights.hidden_size, bundle.window_steps
    hidden = np.full((rows, size), 0.1, dtype=np.float32)
    weights = np.ascontiguousarray(bundle.weights.hidden_weight.reshape(3, size, size).transpose(0, 2, 1))
    out = np.empty((3, rows, size), dtype=np.float32)
    return lambda: np.matmul(hidden, weights, out=out)


def _torch_window(bundle: Bundle) -> Callable[[], object]:
    """Torch's forward pass of the same network over one window: what running it with torch would cost each tick."""
    import torch

    torch.set_num_threads(1)  # as the numpy engine runs; more would spin on a loaded machine

    from hilbridge.learning.training.network import GruNetwork

    network = GruNetwork(hidden=bundle.weights.hidden_size, classes=len(bundle.vocabulary)).eval()
    x, usable = torch.randn(1, bundle.window_steps, D), torch.ones(1, bundle.window_steps)

    def forward() -> object:
        with torch.inference_mode():
            return network(x, usable)

    forward()
    return forward


def _onnx_window(bundle: Bundle) -> Callable[[], object]:
    import onnxruntime

    from hilbridge.exchange.onnx_model import onnx_model

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(
        onnx_model(bundle).SerializeToString(), options, providers=["CPUExecutionProvider"]
    )
    values = np.stack([vector.values for vector in drawn_vectors(bundle.window_steps)])
    given = {"values": values, "valid": np.ones((bundle.window_steps, 3), dtype=bool)}
    session.run(None, given)
    return lambda: session.run(None, given)
