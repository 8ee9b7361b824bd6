"""Test vectors of a bundle: a short stream of features, and what the trained network made of it.

Tensors of the right names and shapes may still be in the wrong order: GRU blocks as another program lays them out,
the statistics of another data set. Such a network predicts, wrongly and with confidence. The training program, which has
the network itself, stores what it gives; loading computes the same with the running engine and compares.

The stream is drawn by a seed, so that no vector holds a recorded person.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hilbridge.features.layout import D
from hilbridge.intent.gru import StreamingGru, Weights
from hilbridge.intent.standardise import standardise

WINDOWS = 10
MAX_DIFFERENCE = 1e-3  # of a logit; two engines in float32 differ by 1e-5
_SEED = 20_260_101
_LOST_SHARE = 0.1  # of all steps, for each modality


@dataclass(frozen=True, slots=True)
class Vectors:
    """values (S, D) raw features; valid (S, 3); logits (W, K) of the windows that end at the last W = S - T + 1 steps."""

    values: NDArray[np.float32]
    valid: NDArray[np.bool_]
    logits: NDArray[np.float32]


def drawn_stream(
    mean: NDArray[np.float32], std: NDArray[np.float32], window_steps: int
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Features (S, D) spread as the training data were, and which modalities they have (S, 3)."""
    random = np.random.default_rng(_SEED)
    steps = window_steps + WINDOWS - 1
    values = (mean + std * random.standard_normal((steps, D))).astype(np.float32)
    return values, random.random((steps, 3)) >= _LOST_SHARE


def largest_difference(
    weights: Weights, mean: NDArray[np.float32], std: NDArray[np.float32], window_steps: int, vectors: Vectors
) -> float:
    """The largest difference between a stored logit and the running engine's; NaN where one is not finite."""
    engine = StreamingGru(weights, window_steps)
    x = standardise(vectors.values, vectors.valid, mean, std)
    found = [engine.step(step, bool(valid.any())) for step, valid in zip(x, vectors.valid, strict=True)]
    logits = np.stack([step for step in found if step is not None])
    return float(np.abs(logits - vectors.logits).max())
