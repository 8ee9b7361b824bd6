"""The network in torch, on one screen (paper, "Inputs and Encoder"), its transformer ablation, and the way to numpy."""

from __future__ import annotations

import numpy as np
import torch
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from torch import Tensor, nn

from hilbridge.features.layout import D
from hilbridge.intent.gru import POOL_EPSILON, Weights
from hilbridge.intent.standardise import standardise
from hilbridge.intent.vectors import Vectors, drawn_stream
from hilbridge.verbs import VERBS


class GruNetwork(nn.Module):
    """FC -> GRU -> masked mean pooling -> linear. x (B, T, D) z-scored, usable (B, T) u_t -> logits (B, K)."""

    def __init__(
        self, inputs: int = D, inner: int = 64, hidden: int = 256, classes: int = len(VERBS), dropout: float = 0.1
    ):
        super().__init__()
        self.fc = nn.Linear(inputs, inner)
        self.gru = nn.GRU(inner, hidden, batch_first=True)
        self.dropout = nn.Dropout(dropout)
        self.head = nn.Linear(hidden, classes)

    def pool(self, x: Tensor, usable: Tensor) -> Tensor:
        """The pooled hidden state (B, H)."""
        states, _ = self.gru(torch.relu(self.fc(x)))
        return masked_mean(states, usable)

    def forward(self, x: Tensor, usable: Tensor) -> Tensor:
        logits: Tensor = self.head(self.dropout(self.pool(x, usable)))
        return logits


class TransformerNetwork(nn.Module):
    """The paper's architectural ablation: a small encoder on the same inputs, the same pooling and head."""

    def __init__(
        self, inputs: int = D, width: int = 64, classes: int = len(VERBS), dropout: float = 0.1, steps: int = 50
    ):
        super().__init__()
        self.fc = nn.Linear(inputs, width)
        self.place = nn.Parameter(torch.zeros(1, steps, width))
        layer = nn.TransformerEncoderLayer(width, 4, 2 * width, dropout, batch_first=True)
        self.encoder = nn.TransformerEncoder(layer, 2, enable_nested_tensor=False)
        self.head = nn.Linear(width, classes)

    def pool(self, x: Tensor, usable: Tensor) -> Tensor:
        """The pooled hidden state (B, width)."""
        return masked_mean(self.encoder(self.fc(x) + self.place[:, : x.shape[1]]), usable)

    def forward(self, x: Tensor, usable: Tensor) -> Tensor:
        logits: Tensor = self.head(self.pool(x, usable))
        return logits


def masked_mean(states: Tensor, usable: Tensor) -> Tensor:
    """(B, T, H), (B, T) -> (B, H)."""
    weight = usable.to(states.dtype).unsqueeze(-1)
    return (states * weight).sum(dim=1) / (weight.sum(dim=1) + POOL_EPSILON)


def export_weights(network: GruNetwork, logit_offset: NDArray[np.float64]) -> Weights:
    """The network as the numpy engine takes it; `logit_offset` (K,) is the log-prior correction of the bias."""

    def array(tensor: Tensor | nn.Module) -> NDArray[np.float32]:
        assert isinstance(tensor, Tensor)
        return tensor.detach().cpu().numpy().astype(np.float32, copy=True)

    gru = network.gru
    return Weights(
        array(network.fc.weight),
        array(network.fc.bias),
        array(gru.weight_ih_l0),
        array(gru.bias_ih_l0),
        array(gru.weight_hh_l0),
        array(gru.bias_hh_l0),
        array(network.head.weight),
        array(network.head.bias) + logit_offset.astype(np.float32),
    )


def network_vectors(
    network: GruNetwork,
    logit_offset: NDArray[np.float64],
    mean: NDArray[np.float32],
    std: NDArray[np.float32],
    steps: int,
) -> Vectors:
    """What this network, in torch and window by window, makes of the drawn stream: the bundle's test vectors."""
    values, valid = drawn_stream(mean, std, steps)
    x = sliding_window_view(standardise(values, valid, mean, std), steps, axis=0).transpose(0, 2, 1).copy()
    usable = sliding_window_view(valid.any(axis=-1), steps).copy()
    network.eval()
    with torch.inference_mode():
        logits = network(torch.from_numpy(x), torch.from_numpy(usable)).numpy()
    return Vectors(values, valid, (logits + logit_offset).astype(np.float32))
