"""Feature packs: a person's feature vectors and labels in one compressed file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import InputError
from hilbridge.features.layout import D


def write_pack(path: Path, values: NDArray[np.float32], valid: NDArray[np.bool_]) -> None:
    """Keep one session's features, so that videos are read once; the file is whole or not there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    # Not *.npz: what an interruption leaves behind must not be taken for a session.
    partial = path.with_name(path.name + ".partial")
    with partial.open("wb") as file:
        np.savez_compressed(file, values=values, valid=valid)
    partial.replace(path)


def read_pack(path: Path) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Features kept by `write_pack`. Raises InputError naming the file for anything else."""
    try:
        with np.load(path, allow_pickle=False) as pack:
            values, valid = np.asarray(pack["values"], np.float32), np.asarray(pack["valid"], bool)
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise InputError(f"{path}: not a feature pack ({type(error).__name__}); extract it again") from None
    if values.ndim != 2 or values.shape[1] != D or valid.shape != (len(values), 3) or not np.isfinite(values).all():
        raise InputError(
            f"{path}: shapes {values.shape} and {valid.shape}, expected (N, {D}) and (N, 3); extract it again"
        )
    return values, valid
