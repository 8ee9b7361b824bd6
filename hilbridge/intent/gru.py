"""The network in numpy: FC -> one-layer GRU -> masked mean pooling -> linear (paper, "Inputs and Encoder").

A window of T steps ends at every tick, so T windows are always under way, each a tick behind the other. The streaming
engine keeps their hidden states as T rows, advances all of them by one matrix product and restarts one row per tick:
the result equals the full window's, at a fraction of its cost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]
POOL_EPSILON = 1e-6


@dataclass(frozen=True, slots=True)
class Weights:
    """float32, as torch lays them out: GRU blocks in the order reset, update, new.

    fc_weight (F, D), fc_bias (F,), input_weight (3H, F), input_bias (3H,), hidden_weight (3H, H), hidden_bias (3H,),
    head_weight (K, H), head_bias (K,).
    """

    fc_weight: Array
    fc_bias: Array
    input_weight: Array
    input_bias: Array
    hidden_weight: Array
    hidden_bias: Array
    head_weight: Array
    head_bias: Array

    @property
    def hidden_size(self) -> int:
        """H."""
        return int(self.hidden_weight.shape[1])


class StreamingGru:
    """All T staggered windows of one stream. `step` once per tick; None until the first window is full."""

    def __init__(self, weights: Weights, window_steps: int) -> None:
        self._w = weights
        self._steps = window_steps
        self._hidden_weight_t = np.ascontiguousarray(weights.hidden_weight.T)
        rows, size = window_steps, weights.hidden_size
        self._hidden = np.zeros((rows, size), dtype=np.float32)
        self._sum = np.zeros((rows, size), dtype=np.float32)
        self._count = np.zeros(rows, dtype=np.float32)
        self._gates = np.empty((rows, 3 * size), dtype=np.float32)
        self._new = np.empty((rows, size), dtype=np.float32)
        self._tick = 0

    def reset(self) -> None:
        """Forget all windows."""
        self._hidden[:] = 0.0
        self._sum[:] = 0.0
        self._count[:] = 0.0
        self._tick = 0

    def step(self, x: Array, usable: bool) -> Array | None:
        """x: (D,) float32 z-scored with zeros for what is masked; usable: u_t. -> logits (K,) of the window ended."""
        row = self._tick % self._steps
        self._hidden[row] = 0.0
        self._sum[row] = 0.0
        self._count[row] = 0.0
        self._advance(x)
        if usable:
            self._sum += self._hidden
            self._count += 1.0
        self._tick += 1
        if self._tick < self._steps:
            return None
        full = self._tick % self._steps
        pooled = self._sum[full] / (self._count[full] + np.float32(POOL_EPSILON))
        return np.asarray(self._w.head_weight @ pooled + self._w.head_bias, dtype=np.float32)

    def usable_steps(self) -> int:
        """How many steps of the window that ended last were usable."""
        return int(self._count[self._tick % self._steps])

    def _advance(self, x: Array) -> None:
        w, size, gates, new = self._w, self._w.hidden_size, self._gates, self._new
        projected = np.maximum(w.fc_weight @ x + w.fc_bias, np.float32(0.0))
        from_input = w.input_weight @ projected + w.input_bias
        np.matmul(self._hidden, self._hidden_weight_t, out=gates)
        gates += w.hidden_bias
        ru = gates[:, : 2 * size]
        ru += from_input[: 2 * size]
        # sigmoid(z) = (1 + tanh(z / 2)) / 2: one fast call, no overflow.
        ru *= np.float32(0.5)
        np.tanh(ru, out=ru)
        ru += np.float32(1.0)
        ru *= np.float32(0.5)
        np.multiply(gates[:, :size], gates[:, 2 * size :], out=new)
        new += from_input[2 * size :]
        np.tanh(new, out=new)
        # h = (1 - z) n + z h = n + z (h - n)
        self._hidden -= new
        self._hidden *= gates[:, size : 2 * size]
        self._hidden += new


def full_window(weights: Weights, window: Array, usable: NDArray[np.bool_]) -> Array:
    """The same network over one whole window, step by step: window (T, D), usable (T,) -> logits (K,)."""
    engine = StreamingGru(weights, len(window))
    logits: Array | None = None
    for x, flag in zip(window, usable, strict=True):
        logits = engine.step(x, bool(flag))
    assert logits is not None
    return logits
