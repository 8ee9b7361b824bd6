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
_ZERO, _HALF, _ONE = (np.float32(number) for number in (0.0, 0.5, 1.0))


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
    """All T staggered windows of one stream. `step` once per tick; None until the first window is full.

    What a tick costs is one product of (T, H) by (H, 3H); the rest is kept small beside it: every gate is a block of its
    own, and what is constant is folded into weights and biases once.
    """

    def __init__(self, weights: Weights, window_steps: int) -> None:
        self._w = weights
        self._steps = window_steps
        rows, size = window_steps, weights.hidden_size
        # sigmoid(z) = (1 + tanh(z / 2)) / 2, one fast call without overflow: the half of z is in the weights. The half of
        # the reset gate is in the block it multiplies, n = tanh(i + r (W h + b)), so that all three blocks are halved.
        self._input_weight = weights.input_weight.copy()
        self._input_weight[: 2 * size] *= np.float32(0.5)
        halved = weights.hidden_weight * np.float32(0.5)
        self._hidden_weight_t = np.ascontiguousarray(halved.reshape(3, size, size).transpose(0, 2, 1))
        # Biases of input and hidden state are one, but for the new state's: the reset gate takes of the hidden one only.
        self._bias = weights.input_bias.copy()
        self._bias[: 2 * size] += weights.hidden_bias[: 2 * size]
        self._bias[: 2 * size] *= np.float32(0.5)
        self._reset_bias = weights.hidden_bias[2 * size :] * np.float32(0.5)
        self._hidden = np.zeros((rows, size), dtype=np.float32)
        self._sum = np.zeros((rows, size), dtype=np.float32)
        self._count = [0] * rows
        self._gates = np.empty((3, rows, size), dtype=np.float32)
        self._projected = np.empty(weights.fc_bias.shape, dtype=np.float32)
        self._from_input = np.empty(3 * size, dtype=np.float32)
        self._tick = 0

    def reset(self) -> None:
        """Forget all windows."""
        self._hidden[:] = 0.0
        self._sum[:] = 0.0
        self._count = [0] * self._steps
        self._tick = 0

    def step(self, x: Array, usable: bool) -> Array | None:
        """x: (D,) float32 z-scored with zeros for what is masked; usable: u_t. -> logits (K,) of the window ended."""
        row = self._tick % self._steps
        self._hidden[row] = 0.0
        self._sum[row] = 0.0
        self._count[row] = 0
        self._advance(x)
        if usable:
            self._sum += self._hidden
            self._count = [count + 1 for count in self._count]
        self._tick += 1
        if self._tick < self._steps:
            return None
        full = self._tick % self._steps
        pooled = self._sum[full] / (np.float32(self._count[full]) + np.float32(POOL_EPSILON))
        return np.asarray(self._w.head_weight @ pooled + self._w.head_bias, dtype=np.float32)

    def usable_steps(self) -> int:
        """How many steps of the window that ended last were usable."""
        return self._count[self._tick % self._steps]

    def _advance(self, x: Array) -> None:
        w, hidden, gates = self._w, self._hidden, self._gates
        projected, summed = self._projected, self._from_input
        np.matmul(w.fc_weight, x, out=projected)
        projected += w.fc_bias
        np.maximum(projected, _ZERO, out=projected)
        np.matmul(self._input_weight, projected, out=summed)
        summed += self._bias
        from_input = summed.reshape(3, 1, -1)
        np.matmul(hidden, self._hidden_weight_t, out=gates)
        sigmoids, (reset, update, gated) = gates[:2], gates
        sigmoids += from_input[:2]
        np.tanh(sigmoids, out=sigmoids)
        sigmoids += _ONE  # twice the sigmoid
        gated += self._reset_bias
        gated *= reset
        gated += from_input[2]
        new = np.tanh(gated, out=gated)
        # h = (1 - z) n + z h = n + z (h - n)
        update *= _HALF
        hidden -= new
        hidden *= update
        hidden += new


def full_window(weights: Weights, window: Array, usable: NDArray[np.bool_]) -> Array:
    """The same network over one whole window, step by step: window (T, D), usable (T,) -> logits (K,)."""
    engine = StreamingGru(weights, len(window))
    logits: Array | None = None
    for x, flag in zip(window, usable, strict=True):
        logits = engine.step(x, bool(flag))
    assert logits is not None
    return logits
