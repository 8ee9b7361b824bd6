"""Raw features in, z-scores out: what the network was trained on (paper, "Inputs and Encoder")."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hilbridge.features.layout import MODALITY_OF

Z_LIMIT = 8.0


def standardise(
    values: NDArray[np.float32], valid: NDArray[np.bool_], mean: NDArray[np.float32], std: NDArray[np.float32]
) -> NDArray[np.float32]:
    """z-scores with zeros (the training mean) for invalid modalities: values (..., D), valid (..., 3) -> (..., D)."""
    z = np.asarray(values - mean, dtype=np.float32)
    z /= std
    np.minimum(z, np.float32(Z_LIMIT), out=z)
    np.maximum(z, np.float32(-Z_LIMIT), out=z)
    if not valid.all():
        z[~valid[..., MODALITY_OF]] = 0.0
    return z
