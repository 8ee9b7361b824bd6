"""Labels of a wearer's verbs: spans of a recording, checked against the vocabulary, as CSV and as rows.

Times are milliseconds from the recording's first row. `none` says that the wearer did and prepared nothing; a span that
nobody labelled says nothing at all. The CSV has the columns start_ms, end_ms, verb, source.
"""

from __future__ import annotations

import csv
import io
import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from hilbridge.errors import InputError, nearest
from hilbridge.labels.vocabulary import FILE, vocabulary_at
from hilbridge.rows import LabelRow
from hilbridge.verbs import NONE, VERBS

VOCABULARY = (*VERBS, NONE)
COLUMNS = ("start_ms", "end_ms", "verb", "source")
_MOST_MS = 7 * 24 * 3_600_000.0
_MOST_BYTES = 16 << 20
_MS = 1_000_000


@dataclass(frozen=True, slots=True)
class Label:
    """What the wearer did from `start_ms` to `end_ms`, and who says so."""

    start_ms: float
    end_ms: float
    verb: str
    source: str


def words_at(place: Path, *more: str) -> tuple[str, ...]:
    """What may stand as a verb in the labels of `place`: its vocabulary, `more`, and `none`."""
    return tuple(dict.fromkeys((*vocabulary_at(place).names, *more, NONE)))


def verb_named(text: str, where: str, words: Sequence[str] = VOCABULARY) -> str:
    """The word that `text` is, whatever its case. Raises InputError with the nearest one."""
    folded = " ".join(text.split()).casefold()
    known = next((word for word in words if word.casefold() == folded), None)
    if known is not None:
        return known
    raise InputError(
        f"{where}: {text[:60]!r} is no verb; {nearest(folded, words)} (a data set with others names them in {FILE})"
    )


def label_of(
    start_ms: float, end_ms: float, verb: str, source: str, where: str, words: Sequence[str] = VOCABULARY
) -> Label:
    """A checked label; `where` begins the message. Raises InputError."""
    if not (
        math.isfinite(start_ms) and math.isfinite(end_ms) and abs(start_ms) <= _MOST_MS and abs(end_ms) <= _MOST_MS
    ):
        raise InputError(f"{where}: times {start_ms} to {end_ms} ms are no times of a recording; write milliseconds")
    if start_ms < 0:
        raise InputError(f"{where}: starts {-start_ms:g} ms before the recording; correct it, or give --offset-ms")
    if end_ms <= start_ms:
        raise InputError(f"{where}: ends at {end_ms:g} ms, not after its start at {start_ms:g} ms; correct it")
    return Label(start_ms, end_ms, verb_named(verb, where, words), source)


def in_order(labels: Iterable[Label], name: str) -> list[Label]:
    """By start. Raises InputError where two overlap: a wearer does one thing at a time."""
    ordered = sorted(labels, key=lambda label: (label.start_ms, label.end_ms))
    for one, other in itertools.pairwise(ordered):
        if other.start_ms < one.end_ms:
            raise InputError(
                f"{name}: {one.verb} ({one.start_ms:g} to {one.end_ms:g} ms) and {other.verb} (from {other.start_ms:g} ms) "
                "overlap; end one before the other begins"
            )
    return ordered


def read_text(path: Path) -> str:
    """A label file as text; a byte order mark is read over. Raises InputError."""
    try:
        if path.is_file() and path.stat().st_size > _MOST_BYTES:
            raise InputError(f"{path}: {path.stat().st_size} bytes, more than any label file; name another")
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: not UTF-8 text; save it as UTF-8") from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; name a label file") from None


def read_csv(path: Path, words: Sequence[str] = ()) -> list[Label]:
    """words: what may stand as a verb; default, by the file's place. Raises InputError naming file and line."""
    text = read_text(path)
    words = words or words_at(path)
    lines = csv.DictReader(io.StringIO(text), delimiter=delimiter_of(text))
    labels = []
    try:
        absent = [column for column in COLUMNS[:3] if column not in (lines.fieldnames or ())]
        if absent:
            raise InputError(f"{path}: no column {absent[0]}; a label file begins with {','.join(COLUMNS)}")
        for row in lines:
            where = f"{path}:{lines.line_num}"
            start_ms, end_ms = (number(row[column], where) for column in COLUMNS[:2])
            labels.append(label_of(start_ms, end_ms, row["verb"] or "", row.get("source") or path.name, where, words))
    except csv.Error as error:
        raise InputError(f"{path}:{lines.line_num}: {error}; correct the line") from None
    return in_order(labels, str(path))


def delimiter_of(text: str) -> str:
    """Of a header line: semicolon and tab where they stand more often than commas."""
    first = text.partition("\n")[0]
    return max(",;\t", key=first.count)


def number(text: str | None, where: str) -> float:
    """A number with a point or a decimal comma. Raises InputError."""
    try:
        return float((text or "").replace(",", "."))
    except ValueError:
        raise InputError(f"{where}: {(text or '')[:60]!r} is no number; write milliseconds such as 1200") from None


def csv_text(labels: Sequence[Label]) -> str:
    """The CSV of these labels, which `read_csv` reads back to equal ones."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows((_short(label.start_ms), _short(label.end_ms), label.verb, label.source) for label in labels)
    return out.getvalue()


def _short(value_ms: float) -> str:
    return str(int(value_ms)) if value_ms == int(value_ms) else repr(value_ms)


def as_row(label: Label, begin_ns: int) -> LabelRow:
    """On the recording's clock, whose first row stands at `begin_ns`."""
    start_ns, end_ns = (begin_ns + round(value_ms * _MS) for value_ms in (label.start_ms, label.end_ms))
    return LabelRow(start_ns, end_ns, label.verb, label.source)


def from_row(row: LabelRow, begin_ns: int) -> Label:
    """The label of a row."""
    return Label((row.time_ns - begin_ns) / _MS, (row.end_ns - begin_ns) / _MS, row.verb, row.source)
