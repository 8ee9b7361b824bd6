"""`--data PATH...`: whatever kind of folder or file each is, sessions of people come out of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from hilbridge.errors import InputError
from hilbridge.labels.table import read_csv
from hilbridge.learning.data.egtea import ANNOTATIONS
from hilbridge.learning.data.labelled import Spanned
from hilbridge.learning.data.people import People, Session, egtea_sessions, pack_sessions, people_of, span_of
from hilbridge.people.group import iassistadl_sessions
from hilbridge.people.recordings import recorded_session

Say = Callable[[str], None]


def load_people(paths: Sequence[Path], say: Say = lambda _: None) -> People:
    """Everybody under these paths. Raises InputError naming the file that is not what it should be, or what is missing."""
    sessions = [session for path in paths for session in sessions_of(path, say)]
    names = [session.name for session in sessions]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"--data: session {twice[0]} is there twice; name each recording once")
    unlabelled = [session.name for session in sessions if not session.stream.known.any()]
    for name in unlabelled:
        say(f"{name}: no label lies within it, left out")
    return people_of(sessions)


def sessions_of(path: Path, say: Say) -> list[Session]:
    """The sessions of one path."""
    if not path.exists():
        raise InputError(f"--data {path}: no such file or folder; name recordings, or a data set's folder")
    if path.is_file():
        return _recordings([path], say)
    if (path / ANNOTATIONS).is_file():
        return egtea_sessions(path, say)
    made = [
        *_recordings(_places(path), say),
        *pack_sessions(path, _spans, say),
        *iassistadl_sessions(path, _spans, say),
    ]
    if not made:
        raise InputError(
            f"--data {path}: neither labelled recordings, nor an EGTEA Gaze+ folder, nor labelled feature packs in it; "
            "`hilbridge label FILE` labels a recording"
        )
    return made


def _places(folder: Path) -> list[Path]:
    """Recordings under a folder: the folders of runs, and single files."""
    runs = sorted(path.parent for path in folder.rglob("recording.mcap"))
    files = sorted(path for path in folder.rglob("*.mcap") if not path.name.startswith("recording."))
    return [*runs, *files]


def _recordings(places: Sequence[Path], say: Say) -> list[Session]:
    made = []
    for place in places:
        session = recorded_session(place)
        if session is None:
            say(f"{place}: no labels, left out (`hilbridge label {place}`)")
        else:
            made.append(session)
    return made


def _spans(path: Path) -> list[Spanned] | None:
    """The labels of a CSV; None where there is none."""
    if not path.is_file():
        return None
    return [span_of(label.verb, label.start_ms, label.end_ms) for label in read_csv(path)]
