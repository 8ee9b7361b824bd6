"""`--data PATH...`: whatever kind of folder or file each is, sessions of people come out of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from hilbridge.errors import InputError
from hilbridge.features.packs import file_hash
from hilbridge.labels.table import read_csv, words_at
from hilbridge.labels.vocabulary import FILE, vocabulary_at, vocabulary_file
from hilbridge.learning.data.egtea import ANNOTATIONS
from hilbridge.learning.data.labelled import Spanned
from hilbridge.learning.data.people import USUAL, Naming, People, Session, egtea_sessions, pack_sessions, people_of
from hilbridge.people.group import iassistadl_sessions
from hilbridge.people.recordings import recorded_session
from hilbridge.verbs import DEFAULT, Vocabulary

Say = Callable[[str], None]


def load_people(paths: Sequence[Path], say: Say = lambda _: None, met: Vocabulary | None = None) -> People:
    """Everybody under these paths. met: the verbs of a bundle that meets them; default: the data say which there are.

    Raises InputError naming the file that is not what it should be, or what is missing.
    """
    naming = Naming(one_vocabulary(paths)) if met is None else Naming(met, strict=False)
    sessions = [session for path in paths for session in sessions_of(path, say, naming)]
    names = [session.name for session in sessions]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"--data: session {twice[0]} is there twice; name each recording once")
    unlabelled = [session.name for session in sessions if not session.stream.known.any()]
    for name in unlabelled:
        say(f"{name}: no label lies within it, left out")
    return people_of(sessions, naming.vocabulary)


def one_vocabulary(paths: Sequence[Path]) -> Vocabulary:
    """The verbs of all these data. Raises InputError where they do not agree."""
    found = {path: vocabulary_at(path) for path in paths}
    for path, vocabulary in found.items():
        if vocabulary != found[paths[0]]:
            raise InputError(
                f"--data {path}: its vocabulary ({len(vocabulary)} verbs) is another than that of {paths[0]} "
                f"({len(found[paths[0]])}); give both the same {FILE}"
            )
    return found[paths[0]] if paths else DEFAULT


def sessions_of(path: Path, say: Say, naming: Naming = USUAL) -> list[Session]:
    """The sessions of one path; the vocabulary's file is one of those that each was made from."""
    made = _sessions_of(path, say, naming)
    named = vocabulary_file(path)
    if named is None:
        return made
    return [replace(one, files={**one.files, FILE: file_hash(named)}) for one in made]


def _sessions_of(path: Path, say: Say, naming: Naming) -> list[Session]:
    if not path.exists():
        raise InputError(f"--data {path}: no such file or folder; name recordings, or a data set's folder")
    if path.is_file():
        return _recordings([path], say, naming)
    if (path / ANNOTATIONS).is_file():
        return egtea_sessions(path, say, naming)
    spans, verbs = partial(_spans, naming=naming), len(naming.vocabulary)
    made = [
        *_recordings(_places(path), say, naming),
        *pack_sessions(path, spans, say, verbs),
        *iassistadl_sessions(path, spans, say, verbs),
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


def _recordings(places: Sequence[Path], say: Say, naming: Naming) -> list[Session]:
    made = []
    for place in places:
        session = recorded_session(place, naming)
        if session is None:
            say(f"{place}: no labels, left out (`hilbridge label {place}`)")
        else:
            made.append(session)
    return made


def _spans(path: Path, naming: Naming) -> list[Spanned] | None:
    """The labels of a CSV; None where there is none."""
    if not path.is_file():
        return None
    labels = read_csv(path, words_at(path, *naming.vocabulary.names))
    return [naming.span(label.verb, label.start_ms, label.end_ms, str(path)) for label in labels]
