"""Removes one person's recordings and what was made of them. Only what a recording itself says is that person's goes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from hilbridge.errors import InputError
from hilbridge.observe.reading import read_recording
from hilbridge.rows import MetaRow

# What commands of ours leave beside a recording, by name; anything else in its folder is somebody's own.
_MADE = ("report.html", "replay.html", "device.jsonl")


@dataclass(frozen=True, slots=True)
class Plan:
    """files: the person's. named: files and folders that only have the pseudonym in their names. unread: could be theirs."""

    files: tuple[Path, ...]
    named: tuple[Path, ...]
    unread: tuple[tuple[Path, str], ...]


def plan_to_forget(participant: str, folder: Path) -> Plan:
    """What belongs to `participant` under `folder`. Raises InputError."""
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; name the one that recordings are kept in")
    if not participant.strip():
        raise InputError("participant: empty; name the pseudonym as recordings have it")
    theirs: list[Path] = []
    unread: list[tuple[Path, str]] = []
    for path in sorted(_under(folder)):
        if path.suffix != ".mcap":
            continue
        try:
            if participant_of(path) == participant:
                theirs.append(path)
        except InputError as error:
            unread.append((path, str(error)))
    files = dict.fromkeys(theirs)
    for path in theirs:
        files.update(dict.fromkeys(sorted(_made_of(path))))
    named = [path for path in sorted(_under(folder)) if participant in path.name and path not in files]
    return Plan(tuple(files), tuple(named), tuple(unread))


def participant_of(path: Path) -> str | None:
    """The pseudonym in a recording; None where it has none. Raises InputError for what cannot be read."""
    for row in read_recording(path, (MetaRow.topic,)):
        if isinstance(row, MetaRow):
            return row.participant
    return None


def carry_out(plan: Plan) -> list[tuple[Path, str]]:
    """Remove the files, and folders that are empty then; gives what could not be removed, and why."""
    failed = []
    for path in plan.files:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            failed.append((path, error.strerror or str(error)))
    for parent in {path.parent for path in plan.files}:
        try:
            parent.rmdir()
        except OSError:  # something else is in it
            continue
    return failed


def _under(folder: Path) -> Iterator[Path]:
    """Every file, without following links out of the folder."""
    for place, _, names in os.walk(folder, followlinks=False):
        for name in names:
            path = Path(place) / name
            if not path.is_symlink():
                yield path


def _made_of(recording: Path) -> Iterator[Path]:
    stem = recording.name.removesuffix(".mcap")
    for path in recording.parent.iterdir():
        of_this = path.name.startswith(f"{stem}.") or path.name in _MADE
        if of_this and path.is_file() and not path.is_symlink():
            yield path
