"""Feature packs: a person's feature vectors and labels in one compressed file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import InputError
from hilbridge.features.layout import D
from hilbridge.files import in_place_of


def write_pack(
    path: Path, values: NDArray[np.float32], valid: NDArray[np.bool_], made_from: Mapping[str, str] | None = None
) -> None:
    """Keep one session's features, so that videos are read once; the file is whole or not there.

    `made_from` names the files it was made of, each with its SHA-256. Raises InputError for a session without a step.
    """
    if len(values) == 0:
        raise InputError(f"{path}: nothing to keep, the session has no step; check its gaze and video")
    # Not *.npz meanwhile: what an interruption leaves behind must not be taken for a session.
    with in_place_of(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, values=values, valid=valid, made_from=json.dumps(dict(made_from or {})))


def file_hash(path: Path) -> str:
    """SHA-256 of a file, as hex."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def pack_made_from(path: Path) -> dict[str, str]:
    """The files a pack was made of with their SHA-256; empty for a pack that does not say. Raises InputError."""
    try:
        with np.load(path, allow_pickle=False) as pack:
            said = json.loads(str(pack["made_from"])) if "made_from" in pack else {}
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise InputError(f"{path}: not a feature pack ({type(error).__name__}); extract it again") from None
    return {str(name): str(digest) for name, digest in said.items()} if isinstance(said, dict) else {}


def read_pack(path: Path) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Features kept by `write_pack`. Raises InputError naming the file for anything else."""
    try:
        with np.load(path, allow_pickle=False) as pack:
            values, valid = np.asarray(pack["values"], np.float32), np.asarray(pack["valid"], bool)
    except (OSError, ValueError, KeyError, EOFError) as error:
        raise InputError(f"{path}: not a feature pack ({type(error).__name__}); extract it again") from None
    if len(values) == 0:
        raise InputError(f"{path}: an empty feature pack; delete it and extract it again")
    if values.ndim != 2 or values.shape[1] != D or valid.shape != (len(values), 3) or not np.isfinite(values).all():
        raise InputError(
            f"{path}: shapes {values.shape} and {valid.shape}, expected (N, {D}) and (N, 3); extract it again"
        )
    return values, valid
