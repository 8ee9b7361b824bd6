"""Annotations of EGTEA Gaze+ as the official package has them on disk (paper, "Dataset, Task, Splits").

`action_annotation/raw_annotations/action_labels.csv` is `;`-separated with a `#` header; the subject is the session's
text before the first `-`. Verbs are normalised to the 20 of `hilbridge.verbs` and `other`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from hilbridge.errors import InputError
from hilbridge.verbs import OTHER, VERBS

ANNOTATIONS = Path("action_annotation/raw_annotations/action_labels.csv")
SPLITS = Path("action_annotation")
GAZE = Path("gaze_data")

_INDEX = {verb.lower(): index for index, verb in enumerate(VERBS)}


class DatasetError(InputError):
    """The folder or a file in it is not what the loader needs; the message names it and the cure."""


@dataclass(frozen=True, slots=True)
class Action:
    """One annotated action; `verb` is as annotated, `label` the class index 0..20; times are ms of the video."""

    session: str
    subject: str
    start_ms: int
    end_ms: int
    verb: str
    label: int


def normalise_verb(verb: str) -> int:
    """Class index of an annotated verb: case and spacing do not matter, what is rare or unknown is `other`."""
    return _INDEX.get(verb.strip().lower().replace(" / ", "/"), OTHER)


def load_actions(root: Path) -> tuple[Action, ...]:
    """Every annotated action under `root`, in order of session and time. Raises DatasetError naming file and line."""
    path = root / ANNOTATIONS
    if not path.is_file():
        raise DatasetError(
            f"{path}: no such file; give the folder of the EGTEA Gaze+ package (it has action_annotation/)"
        )
    actions = []
    for number, line in enumerate(path.read_text(encoding="utf-8-sig", errors="replace").splitlines(), start=1):
        if not line.strip() or line.startswith("#"):
            continue
        cells = [cell.strip() for cell in line.split(";")]
        try:
            session, start_ms, end_ms, verb = cells[2], int(cells[3]), int(cells[4]), cells[6]
        except (IndexError, ValueError):
            raise DatasetError(
                f"{path} line {number}: expected `id; clip; session; start; end; action; verb; ...`; "
                "unpack the annotations again"
            ) from None
        actions.append(Action(session, session.split("-", 1)[0], start_ms, end_ms, verb, normalise_verb(verb)))
    if not actions:
        raise DatasetError(f"{path}: holds no annotation; unpack the annotations again")
    return tuple(sorted(actions, key=lambda action: (action.session, action.start_ms, action.end_ms)))


def by_session(actions: Iterable[Action]) -> dict[str, list[Action]]:
    """Actions grouped by session, each in order of time."""
    sessions: dict[str, list[Action]] = {}
    for action in actions:
        sessions.setdefault(action.session, []).append(action)
    return sessions


def split_counts(root: Path) -> dict[str, int]:
    """Clips named by each official split file that is there, e.g. {"train_split1": 8299, ...}."""
    files = sorted((root / SPLITS).glob("*_split[1-3].txt"))
    return {
        path.stem: sum(
            1 for line in path.read_text(encoding="utf-8-sig", errors="replace").splitlines() if line.strip()
        )
        for path in files
    }


def subjects(actions: Iterable[Action]) -> list[str]:
    """Subjects in a fixed order."""
    return sorted({action.subject for action in actions})


def verb_counts(actions: Sequence[Action]) -> dict[str, int]:
    """How often each annotated (not normalised) verb occurs, most frequent first."""
    return dict(Counter(action.verb for action in actions).most_common())
