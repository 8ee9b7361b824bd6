"""Labels in and out of a recording: our own CSV, ELAN and BORIS, told apart by what is in the file."""

from __future__ import annotations

import math
from pathlib import Path

from hilbridge.errors import InputError
from hilbridge.files import write_whole
from hilbridge.labels.boris import is_boris, read_boris
from hilbridge.labels.elan import read_eaf
from hilbridge.labels.store import labels_of, put_labels, span_of
from hilbridge.labels.table import Label, csv_text, in_order, label_of, read_csv, words_at


def import_labels(recording: Path, source: Path, tier: str | None, offset_ms: float | None) -> tuple[Path, int]:
    """Replace a recording's labels by those of `source`; (the CSV beside it, their number). Raises InputError.

    Times of ELAN and BORIS are those of the video, which begins with the first picture unless `offset_ms` says where.
    """
    if offset_ms is not None and not math.isfinite(offset_ms):
        raise InputError(f"--offset-ms {offset_ms}: not finite; give milliseconds")
    words = words_at(recording)
    if source.suffix.lower() == ".eaf":
        labels = read_eaf(source, tier, _video_start_ms(recording, offset_ms), words)
    elif is_boris(source):
        labels = read_boris(source, _video_start_ms(recording, offset_ms), words)
    else:
        labels = _moved(read_csv(source, words), offset_ms or 0.0, str(source))
    return put_labels(recording, labels), len(labels)


def export_labels(recording: Path, target: Path) -> int:
    """Write a recording's labels as CSV; gives their number. Raises InputError."""
    if target.exists():
        raise InputError(f"{target}: is there already; name another file")
    labels = labels_of(recording)
    write_whole(target, csv_text(labels))
    return len(labels)


def _video_start_ms(recording: Path, offset_ms: float | None) -> float:
    if offset_ms is not None:
        return offset_ms
    span = span_of(recording)
    return 0.0 if span.first_picture_ns is None else max(0.0, (span.first_picture_ns - span.begin_ns) / 1e6)


def _moved(labels: list[Label], offset_ms: float, name: str) -> list[Label]:
    if not offset_ms:
        return labels
    moved = [
        label_of(one.start_ms + offset_ms, one.end_ms + offset_ms, one.verb, one.source, name, (one.verb,))
        for one in labels
    ]
    return in_order(moved, name)
