"""Puts labels beside a recording, as CSV, and into it, as rows of /label; the CSV is what a person edits."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from hilbridge.errors import InputError
from hilbridge.files import in_place_of, write_whole
from hilbridge.labels.table import Label, as_row, csv_text, from_row, in_order
from hilbridge.observe.parts import recordings_in
from hilbridge.observe.reading import RecordingReader, read_recording
from hilbridge.observe.recording import AddsNothing, Recording
from hilbridge.rows import ImageRow, LabelRow, Row


@dataclass(frozen=True, slots=True)
class Span:
    """A recording's first and last row, and its first picture, where it has any; on its own clock."""

    begin_ns: int
    end_ns: int
    first_picture_ns: int | None


def span_of(path: Path) -> Span:
    """Reads the whole recording. Raises InputError."""
    begin_ns: int | None = None
    end_ns, picture_ns = 0, None
    for row in read_recording(path):
        begin_ns = row.time_ns if begin_ns is None else begin_ns
        end_ns = max(end_ns, row.time_ns)
        if picture_ns is None and isinstance(row, ImageRow):
            picture_ns = row.captured_ns
    if begin_ns is None:
        raise InputError(f"recording {path}: has no rows; there is nothing to label")
    return Span(begin_ns, end_ns, picture_ns)


def labels_of(path: Path) -> list[Label]:
    """The labels within a recording. Raises InputError."""
    begin_ns = span_of(path).begin_ns
    return [from_row(row, begin_ns) for row in read_recording(path, (LabelRow.topic,)) if isinstance(row, LabelRow)]


def beside(path: Path) -> Path:
    """The CSV that stands beside a recording, or in its folder."""
    return recordings_in([path])[0].with_suffix(".labels.csv")


def put_labels(path: Path, labels: Sequence[Label], progress: Callable[[int], None] = lambda rows: None) -> Path:
    """Replace a recording's labels, within it and beside it; gives the CSV's path. Raises InputError, OSError.

    Each file is written anew and takes the old one's place when it is whole.
    """
    span, ordered = span_of(path), in_order(labels, str(path))
    late = [label for label in ordered if label.end_ms > (span.end_ns - span.begin_ns) / 1e6 + 1000.0]
    if late:
        raise InputError(
            f"{path}: {late[0].verb} ends at {late[0].end_ms / 1e3:g} s, the recording at "
            f"{(span.end_ns - span.begin_ns) / 1e9:g} s; is it of another recording, or does it need --offset-ms?"
        )
    waiting = [as_row(label, span.begin_ns) for label in ordered]
    parts = recordings_in([path])
    for part in parts:
        reader = read_recording(part)
        with in_place_of(part) as partial, Recording(partial, AddsNothing(reader.schemas)) as out:
            for count, row in enumerate(_labelled(reader, waiting, is_last=part == parts[-1])):
                out.write(row)
                if count % 10_000 == 0:
                    progress(count)
    return write_whole(beside(path), csv_text(ordered))


def _labelled(reader: RecordingReader, waiting: list[LabelRow], *, is_last: bool) -> Iterator[Row]:
    """The rows without their old labels and with those that wait, in order; takes what it gives from `waiting`."""
    for place, row in enumerate(reader):
        while place and waiting and waiting[0].time_ns <= row.time_ns:
            yield waiting.pop(0)
        if not isinstance(row, LabelRow):
            yield row
    while is_last and waiting:
        yield waiting.pop(0)
