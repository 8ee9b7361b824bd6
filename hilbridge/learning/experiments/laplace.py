"""Uncertainty beyond calibration: last-layer Laplace, and MC dropout as the comparator the paper rejects on cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from hilbridge.intent.calibration import softmax
from hilbridge.learning.data.stream import Stream
from hilbridge.learning.data.windows import gather
from hilbridge.learning.metrics import nll
from hilbridge.learning.training.train import Trained

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
PRIOR_PRECISIONS = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)


@dataclass(frozen=True, slots=True)
class Laplace:
    """probabilities (N, K) on the test windows, calibration (M, K) on the others; prior_precision chosen by calibration NLL.

    curvature: mean squared gradient per parameter of each layer (diagonal Fisher), the paper's E2 figure.
    """

    probabilities: Floats
    calibration: Floats
    prior_precision: float
    curvature: dict[str, float]


def pooled(trained: Trained, stream: Stream, ends: Ints, batch: int = 512) -> Floats:
    """Pooled hidden states with a one appended: (N, H + 1), what the last layer is linear in."""
    trained.network.eval()
    parts = []
    with torch.inference_mode():
        for start in range(0, len(ends), batch):
            x, usable = gather(stream, ends[start : start + batch], trained.statistics)
            states = trained.network.pool(torch.from_numpy(x), torch.from_numpy(usable))
            parts.append(states.numpy().astype(np.float64))
    hidden = np.concatenate(parts)
    return np.concatenate([hidden, np.ones((len(hidden), 1))], axis=1)


def last_layer_laplace(
    trained: Trained,
    fitting: Stream,
    fitting_ends: Ints,
    test: Stream,
    test_ends: Ints,
    calibration: Stream,
    calibration_ends: Ints,
) -> Laplace:
    """Gaussian posterior of the last layer, one Kronecker factor per class block; MacKay's probit approximation.

    The variance of logit k is h' (H_k + prior)^-1 h with H_k = sum over windows of p_k (1 - p_k) h h': one small matrix
    product per prediction, no further pass through the network.
    """
    hidden = pooled(trained, fitting, fitting_ends)
    head = np.concatenate(
        [trained.network.head.weight.detach().numpy(), trained.network.head.bias.detach().numpy()[:, None]], axis=1
    ).astype(np.float64)
    p = softmax(hidden @ head.T)
    factors = [np.linalg.eigh((hidden * (p[:, k] * (1.0 - p[:, k]))[:, None]).T @ hidden) for k in range(head.shape[0])]
    rows = {"test": pooled(trained, test, test_ends), "calibration": pooled(trained, calibration, calibration_ends)}

    def predict(h: Floats, prior: float) -> Floats:
        logits = h @ head.T
        variance = np.stack(
            [((h @ vectors) ** 2 / (np.maximum(values, 0.0) + prior)).sum(axis=1) for values, vectors in factors],
            axis=1,
        )
        return softmax(logits / np.sqrt(1.0 + np.pi / 8.0 * variance) + trained.logit_offset)

    labels = calibration.label[calibration_ends]
    prior = min(PRIOR_PRECISIONS, key=lambda value: nll(predict(rows["calibration"], value), labels))
    return Laplace(
        predict(rows["test"], prior),
        predict(rows["calibration"], prior),
        prior,
        curvature(trained, fitting, fitting_ends),
    )


def curvature(trained: Trained, stream: Stream, ends: Ints, windows: int = 192) -> dict[str, float]:
    """Diagonal empirical Fisher, averaged over each layer's parameters, from single windows."""
    trained.network.eval()
    chosen = ends[:: max(1, len(ends) // windows)][:windows]
    x, usable = gather(stream, chosen, trained.statistics)
    sums = {name: 0.0 for name, _ in trained.network.named_parameters()}
    for row in range(len(chosen)):
        trained.network.zero_grad()
        logits = trained.network(torch.from_numpy(x[row : row + 1]), torch.from_numpy(usable[row : row + 1]))
        functional.cross_entropy(logits, torch.from_numpy(stream.label[chosen[row : row + 1]])).backward()  # type: ignore[no-untyped-call]
        for name, parameter in trained.network.named_parameters():
            if parameter.grad is not None:
                sums[name] += float((parameter.grad**2).mean())
    trained.network.zero_grad()
    return {name: total / len(chosen) for name, total in sums.items()}


def dropout_probabilities(trained: Trained, stream: Stream, ends: Ints, passes: int = 10, batch: int = 512) -> Floats:
    """MC dropout: the mean of `passes` stochastic passes (N, K). Costs as many forward passes of the head's input."""
    network = trained.network
    network.eval()
    torch.manual_seed(0)
    parts = []
    with torch.inference_mode():
        for start in range(0, len(ends), batch):
            x, usable = gather(stream, ends[start : start + batch], trained.statistics)
            hidden = network.pool(torch.from_numpy(x), torch.from_numpy(usable))
            total = np.zeros((len(x), len(trained.logit_offset)))
            for _ in range(passes):
                logits = network.head(functional.dropout(hidden, 0.2, training=True)).numpy().astype(np.float64)
                total += softmax(logits + trained.logit_offset)
            parts.append(total / passes)
    return np.concatenate(parts)
