"""Labels from BORIS: its tabular events (START and STOP) and its aggregated events, exported as CSV or TSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from hilbridge.errors import InputError
from hilbridge.labels.table import VOCABULARY, Label, delimiter_of, in_order, label_of, number, read_text

_AGGREGATED = {"Behavior", "Start (s)", "Stop (s)"}
_TABULAR = {"Behavior", "Time"}
_MOST_HEADER = 10_000  # characters
_STATUS = ("Behavior type", "Status")  # of version 8 and of those before


def is_boris(path: Path) -> bool:
    """Whether a line of the file heads a BORIS table."""
    return _header(read_text(path)) is not None


def read_boris(path: Path, offset_ms: float, words: Sequence[str] = VOCABULARY) -> list[Label]:
    """Every state event; `offset_ms` is added. Point events have no length and are refused. Raises InputError."""
    text = read_text(path)
    header = _header(text)
    if header is None:
        raise InputError(f"{path}: no BORIS table; export `tabular events` or `aggregated events` as CSV")
    lines = text.splitlines()
    table = csv.DictReader(io.StringIO("\n".join(lines[header:])), delimiter=delimiter_of(lines[header]))
    names = set(table.fieldnames or ())
    try:
        rows = [(f"{path}:{header + table.line_num}", row) for row in table]
    except csv.Error as error:
        raise InputError(f"{path}: {error}; export it again") from None
    make = _aggregated if names >= _AGGREGATED else _tabular
    labels = make(path, rows, offset_ms, words)
    return in_order(labels, str(path))


def _header(text: str) -> int | None:
    for place, line in enumerate(text.splitlines()[:60]):
        if len(line) > _MOST_HEADER:
            continue
        names = set(next(csv.reader([line], delimiter=delimiter_of(line)), []))
        if names >= _AGGREGATED or (names >= _TABULAR and names & set(_STATUS)):
            return place
    return None


def _aggregated(
    path: Path, rows: list[tuple[str, dict[str, str]]], offset_ms: float, words: Sequence[str]
) -> list[Label]:
    labels = []
    for where, row in rows:
        start_ms, end_ms = (number(row[name], where) * 1e3 + offset_ms for name in ("Start (s)", "Stop (s)"))
        labels.append(label_of(start_ms, end_ms, row["Behavior"], f"boris:{path.name}", where, words))
    return labels


def _tabular(path: Path, rows: list[tuple[str, dict[str, str]]], offset_ms: float, words: Sequence[str]) -> list[Label]:
    begun: dict[str, float] = {}
    labels = []
    for where, row in rows:
        verb, time_ms = row["Behavior"], number(row["Time"], where) * 1e3 + offset_ms
        kind = next((row[name] for name in _STATUS if row.get(name)), "").strip().upper()
        if kind == "START":
            begun[verb] = time_ms
        elif kind == "STOP" and verb in begun:
            labels.append(label_of(begun.pop(verb), time_ms, verb, f"boris:{path.name}", where, words))
        else:
            raise InputError(f"{where}: {kind or 'no kind'} of {verb!r}; only pairs of START and STOP have a length")
    if begun:
        verb = next(iter(begun))
        raise InputError(f"{path}: {verb} begins at {begun[verb] / 1e3:g} s and never stops; add its STOP")
    return labels
