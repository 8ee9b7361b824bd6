"""Which verbs a data set has: `verbs.csv` in its folder (verb, assisted), else the default's 21.

It goes for every label file and recording in that folder and up to three levels below: SUBJECT/SESSION/RECORDING.
"""

from __future__ import annotations

import csv
from pathlib import Path

from hilbridge.errors import InputError
from hilbridge.verbs import DEFAULT, Vocabulary, vocabulary_of

FILE = "verbs.csv"
COLUMNS = ("verb", "assisted")
LEVELS = 3
_MOST_BYTES = 1 << 16
_SAID = {"yes": True, "no": False}


def vocabulary_at(place: Path) -> Vocabulary:
    """Of a recording, a label file or a data set's folder. Raises InputError for a verbs.csv that is none."""
    path = vocabulary_file(place)
    return DEFAULT if path is None else read_vocabulary(path)


def vocabulary_file(place: Path) -> Path | None:
    """The nearest verbs.csv at or above `place`."""
    folder = place if place.is_dir() else place.parent
    above = [folder, *folder.absolute().parents[:LEVELS]]
    return next((one / FILE for one in above if (one / FILE).is_file()), None)


def read_vocabulary(path: Path) -> Vocabulary:
    """Raises InputError naming file and line."""
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise InputError(f"{path}: {path.stat().st_size} bytes, more than any vocabulary; write one verb a line")
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path}: not UTF-8 text; save it as UTF-8") from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; make it readable or remove it") from None
    lines = csv.DictReader(text.splitlines())
    rows = []
    try:
        if tuple(lines.fieldnames or ()) != COLUMNS:
            raise InputError(f"{path}: begins with {lines.fieldnames}; write the header {','.join(COLUMNS)}")
        for row in lines:
            may = _SAID.get((row["assisted"] or "").strip().casefold())
            if may is None:
                raise InputError(f"{path}:{lines.line_num}: assisted is {row['assisted']!r}; write yes or no")
            rows.append((" ".join((row["verb"] or "").split()), may))
        return vocabulary_of(rows)
    except csv.Error as error:
        raise InputError(f"{path}:{lines.line_num}: {error}; correct the line") from None
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: {error}; correct it") from None
