"""Old recordings of people are removed when it was asked for: only our own, only beside the newest, and never unsaid."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from hilbridge.observe.recording import LIBRARY

_DAY_S = 86_400.0
_HEADER = b"\x89MCAP0\r\n\x01"
_HEAD_BYTES = 64


@dataclass(frozen=True, slots=True)
class Removed:
    """Files that are gone, and those that could not be removed with the reason."""

    files: tuple[Path, ...]
    stay: tuple[tuple[Path, str], ...]


def remove_old(newest: Path, days: float, now_s: float) -> Removed:
    """Remove recordings that are older than so many days from the folders beside `newest`, which is a run's folder.

    A recording is what `hilbridge` wrote as recording*.mcap and the same user owns. `newest` itself stays whatever its
    age. A folder that is empty then goes, too; whatever else is in one stays.
    """
    files: list[Path] = []
    stay: list[tuple[Path, str]] = []
    kept = newest.resolve()
    for folder in sorted(path for path in kept.parent.iterdir() if path.is_dir() and not path.is_symlink()):
        if folder == kept:
            continue
        for path in sorted(folder.glob("recording*.mcap")):
            if not _is_ours(path) or now_s - path.stat().st_mtime <= days * _DAY_S:
                continue
            try:
                path.unlink()
                files.append(path)
            except OSError as error:
                stay.append((path, error.strerror or str(error)))
        with suppress(OSError):  # something else is in it
            if any(path.parent == folder for path in files):
                folder.rmdir()
    return Removed(tuple(files), tuple(stay))


def _is_ours(path: Path) -> bool:
    """Whether it is a file of this user's that this program began."""
    try:
        if path.is_symlink() or not path.is_file():
            return False
        if hasattr(os, "getuid") and path.stat().st_uid != os.getuid():
            return False
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError:
        return False
    return head.startswith(_HEADER) and LIBRARY.encode() in head
