"""A long recording in parts, each a whole recording of its own: `recording.mcap`, `recording.2.mcap`, ..."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from hilbridge.errors import InputError
from hilbridge.observe.recording import Adds, Recording
from hilbridge.rows import BundleRow, ConfigRow, HostRow, MetaRow, Row

_FIRST_ROWS = (MetaRow, HostRow, ConfigRow, BundleRow)
_NUMBER = re.compile(r"\.(\d+)$")


@dataclass(frozen=True, slots=True)
class Rotation:
    """When the next part begins; None is never."""

    after_bytes: int | None = None
    after_ns: int | None = None


def part_path(path: Path, part: int) -> Path:
    """The file of a part; the first has the recording's own name."""
    return path if part == 1 else path.with_suffix(f".{part}{path.suffix}")


def part_number(path: Path) -> int:
    """Which part a file is, by its name."""
    found = _NUMBER.search(path.stem)
    return 1 if found is None else int(found[1])


def recordings_in(places: Sequence[Path]) -> list[Path]:
    """Files as they are, and for a folder the parts of the recording in it, in order. Raises InputError."""
    files: list[Path] = []
    for place in places:
        if not place.is_dir():
            files.append(place)
            continue
        found = sorted((*place.glob("recording.mcap"), *place.glob("recording.[0-9]*.mcap")), key=part_number)
        if not found:
            raise InputError(f"recording {place}: a folder without recording.mcap; name a recording or a run's folder")
        files += found
    return files


class RecordingInParts:
    """Writes a recording, and begins the next part when it is time. Each part begins with what the first began with."""

    def __init__(self, path: Path, adds: Adds, rotation: Rotation) -> None:
        """Raises InputError where nothing can be written. Later parts of an earlier recording of that name are removed."""
        self.path = path
        self._adds, self._rotation = adds, rotation
        self._part = 1
        self._first_rows: dict[str, Row] = {}
        self._from_ns: int | None = None
        self.current = Recording(path, adds, is_lasting=True)
        for stale in path.parent.glob(f"{path.stem}.[0-9]*{path.suffix}"):
            stale.unlink()

    def write(self, row: Row) -> None:
        """Append one row. Raises OSError or InputError where the disk is full or gone."""
        if self._from_ns is None:
            self._from_ns = row.time_ns
        if isinstance(row, _FIRST_ROWS):
            self._first_rows[row.topic] = row
        elif self._is_full(row.time_ns - self._from_ns):
            self._next(row.time_ns)
        self.current.write(row)

    def _is_full(self, age_ns: int) -> bool:
        most, longest = self._rotation.after_bytes, self._rotation.after_ns
        return (most is not None and self.current.size >= most) or (longest is not None and age_ns >= longest)

    def _next(self, now_ns: int) -> None:
        self.current.close()
        self._part += 1
        self._from_ns = now_ns
        self.current = Recording(part_path(self.path, self._part), self._adds, is_lasting=True)
        for row in self._first_rows.values():
            later = replace(row, time_ns=now_ns)
            self.current.write(replace(later, part=self._part) if isinstance(later, MetaRow) else later)

    def close(self) -> None:
        """Finish the part under way. Raises OSError."""
        self.current.close()

    def discard(self) -> None:
        """Remove everything that was written."""
        self.current.discard()
        for part in range(1, self._part):
            part_path(self.path, part).unlink(missing_ok=True)
