"""Makes a whole recording of what a crash left."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hilbridge.files import naming
from hilbridge.observe.reading import read_recording
from hilbridge.observe.recording import AddsNothing, Recording


@dataclass(frozen=True, slots=True)
class Recovered:
    """rows: how many were kept. missing: what the damaged file lacked; None where it was whole already."""

    path: Path
    rows: int
    missing: str | None


def recover(path: Path, target: Path | None = None) -> Recovered:
    """Write every row that can be read into `target` (default: NAME.recovered.mcap beside it); the original stays.

    Raises InputError where nothing can be read or written.
    """
    target = target or path.with_suffix(".recovered.mcap")
    reader = read_recording(path)
    rows = iter(reader)
    first = next(rows, None)  # before anything is written: what is no recording leaves no file
    count = 0
    # What was added to rows is among them already.
    with naming(target), Recording(target, AddsNothing(reader.schemas)) as out:
        if first is not None:
            out.write(first)
            count = 1
        for row in rows:
            out.write(row)
            count += 1
    return Recovered(target, count, reader.missing)
