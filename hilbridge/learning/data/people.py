"""Sessions of people: streams with what is true at each step, whoever recorded them, under one set of subject numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hilbridge.features.layout import RATE_HZ, D
from hilbridge.features.packs import file_hash, read_pack
from hilbridge.intent.provenance import Origin
from hilbridge.learning.data.describe import OUTSIDE, outside_share, outside_warning
from hilbridge.learning.data.egtea import ANNOTATIONS, GAZE, DatasetError, by_session, load_actions
from hilbridge.learning.data.labelled import Spanned, labelled_stream
from hilbridge.learning.data.sessions import (
    PACKS,
    gaze_path,
    load_features,
    recorded_sessions,
    session_stream,
    video_path,
)
from hilbridge.learning.data.stream import Stream, join
from hilbridge.learning.data.windows import STEPS
from hilbridge.sensors.begaze import read_begaze
from hilbridge.verbs import DEFAULT, NONE, Vocabulary

LEAST = 3  # people: to train, to stop by, to judge
Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Naming:
    """How words of labels become classes. strict: a verb that the vocabulary lacks is refused, as training must; else it is a
    class of its own after the last, which nobody can predict."""

    vocabulary: Vocabulary = DEFAULT
    strict: bool = True

    def index(self, verb: str, where: str) -> int:
        """Class of a verb, -1 for nothing at all. Raises DatasetError."""
        if verb == NONE:
            return -1
        found = self.vocabulary.find(verb)
        if found is None and self.strict:
            raise DatasetError(
                f"{where}: verb {verb!r} is not of the vocabulary ({', '.join(self.vocabulary.names)}); add it to "
                "verbs.csv, or add the line `other,no` there for all that is rare"
            )
        return len(self.vocabulary) if found is None else found

    def span(self, verb: str, start_ms: float, end_ms: float, where: str) -> Spanned:
        """A label."""
        return Spanned(start_ms, end_ms, self.index(verb, where))


USUAL = Naming()


@dataclass(frozen=True, slots=True)
class Session:
    """One session of one person. files: SHA-256 by name of all that it was made from; stream.subject means nothing yet."""

    name: str
    person: str
    stream: Stream
    origin: Origin
    files: dict[str, str]

    @property
    def known_minutes(self) -> float:
        """Of it, what somebody labelled."""
        return float(self.stream.known.sum()) / RATE_HZ / 60.0


@dataclass(frozen=True, slots=True)
class People:
    """Everybody, numbered as in `names`; `stream` holds them one after the other."""

    names: tuple[str, ...]
    stream: Stream
    sessions: tuple[Session, ...]
    vocabulary: Vocabulary = DEFAULT

    @property
    def origin(self) -> Origin:
        """Recorded only where every session is."""
        recorded = all(session.origin is Origin.RECORDED for session in self.sessions)
        return Origin.RECORDED if recorded else Origin.SIMULATED

    @property
    def minutes(self) -> float:
        """Labelled ones."""
        return sum(session.known_minutes for session in self.sessions)

    @property
    def files(self) -> dict[str, str]:
        """SHA-256 of every file, by session and name."""
        return {f"{session.name}/{name}": digest for session in self.sessions for name, digest in session.files.items()}


def people_of(sessions: Iterable[Session], vocabulary: Vocabulary = DEFAULT) -> People:
    """Number people by their names. Raises DatasetError for too few of them, or of whom nothing is known."""
    used = [session for session in sessions if session.stream.known.any()]
    names = sorted({session.person for session in used})
    if len(names) < LEAST:
        raise DatasetError(
            f"labelled sessions of {len(names)} people; at least {LEAST} are needed (`hilbridge label FILE` labels one)"
        )
    ordered = sorted(used, key=lambda session: (session.person, session.name))
    parts = []
    for session in ordered:
        steps = len(session.stream)
        numbered = replace(session.stream, subject=np.full(steps, names.index(session.person)))
        parts += [numbered, _break(numbered)]
    return People(tuple(names), join(parts), tuple(ordered), vocabulary)


def _break(stream: Stream) -> Stream:
    """A window's length of nothing, so that no window reaches from one session of a person into the next."""
    nothing = np.zeros((STEPS, D), np.float32), np.zeros((STEPS, 3), bool)
    return labelled_stream(int(stream.subject[0]), [], *nothing, gaps_are_idle=False, verbs=stream.verbs)


def egtea_sessions(root: Path, say: Say = lambda _: None, naming: Naming = USUAL) -> list[Session]:
    """Every annotated session of an EGTEA Gaze+ folder of which anything was recorded."""
    annotated = by_session(load_actions(root))
    annotations = file_hash(root / ANNOTATIONS)
    made = []
    for name in recorded_sessions(root):
        if name not in annotated:
            say(f"{name}: no annotations, left out")
            continue
        values, valid = load_features(root, name)
        actions = [replace(one, label=naming.index(one.verb, f"{root}: {name}")) for one in annotated[name]]
        stream, _, counts = session_stream(0, actions, values, valid, len(naming.vocabulary))
        if counts.after_the_recording:
            say(f"{name}: ends before {counts.after_the_recording} of {counts.onsets} annotated actions")
        places = (gaze_path(root, name), video_path(root, name), root / PACKS / f"{name}.npz")
        files = {place.name: file_hash(place) for place in places if place is not None and place.is_file()}
        made.append(
            Session(name, name.split("-", 1)[0], stream, Origin.RECORDED, {ANNOTATIONS.name: annotations, **files})
        )
    for warning in gaze_warnings(root):
        say(warning)
    return made


def gaze_warnings(root: Path) -> list[str]:
    """Sessions whose valid gaze lies outside of the picture more often than is likely for eyes that look at their hands."""
    made = []
    for file in sorted((root / GAZE).glob("*.txt")):
        outside = outside_share(read_begaze(file))
        if outside > OUTSIDE:
            made.append(outside_warning(file.stem, outside))
    return made


def pack_sessions(
    folder: Path,
    spans: Callable[[Path], Sequence[Spanned] | None],
    say: Say = lambda _: None,
    verbs: int = len(DEFAULT),
) -> list[Session]:
    """Feature packs NAME.npz with their labels NAME.labels.csv beside them; the person is the name up to the first `-`."""
    made = []
    for path in sorted(folder.glob("*.npz")):
        labels = path.with_suffix(".labels.csv")
        own = spans(labels)
        if own is None:
            say(f"{path.name}: no {labels.name} beside it, left out")
            continue
        values, valid = read_pack(path)
        stream = labelled_stream(0, own, values, valid, gaps_are_idle=False, verbs=verbs)
        files = {path.name: file_hash(path), labels.name: file_hash(labels)}
        made.append(Session(path.stem, path.stem.split("-", 1)[0], stream, Origin.RECORDED, files))
    return made
