"""`hilbridge adapt`: a bundle that knows one wearer, from labelled sessions of theirs. It only ever gets more careful."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hilbridge.errors import InputError
from hilbridge.intent.bundle import load_bundle, save_bundle
from hilbridge.intent.online import Usual
from hilbridge.learning.data.people import Naming
from hilbridge.learning.data.stream import join
from hilbridge.learning.training.make_bundle import replay_bundle
from hilbridge.learning.training.person import actions_of, posterior, shifted
from hilbridge.people.load import sessions_of

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Adapted:
    """What one wearer's actions came to. used: the intercept in log odds that the bundle was given, never above 0."""

    person: str
    actions: int
    right: int
    intercept: float
    spread: float
    used: float
    written: Path

    def lines(self) -> list[str]:
        """For people."""
        share = f", {self.right} right" if self.actions else ""
        made = [
            f"{self.person}: {self.actions} confirmed actions{share}; log odds {self.intercept:+.2f} (give or take "
            f"{self.spread:.2f}) against the people of the bundle"
        ]
        if self.used < 0.0:
            made.append(f"more careful: every confidence is moved by {self.used:+.2f}; thresholds and certificate stay")
        elif self.intercept > 0.0:
            made.append("this wearer could be trusted more, but nothing is loosened beyond what is certified")
        else:
            made.append("nothing to change: no acts to learn from, or the bundle's people did not differ")
        return [*made, f"bundle: {self.written}"]


def _only_above(usual: Usual | None) -> Usual | None:
    """A wearer whose confidences are moved down is not suspected of low ones."""
    return None if usual is None else usual._replace(low=0.0)


def adapt(bundle_path: Path, data: Sequence[Path], out: Path, say: Say = lambda _: None) -> Adapted:
    """Learn from labelled sessions of one person. Raises InputError for sessions of several, or a bundle that cannot adapt."""
    bundle = load_bundle(bundle_path)
    naming = Naming(bundle.vocabulary, strict=False)
    sessions = [session for path in data for session in sessions_of(path, say, naming)]
    people = sorted({session.person for session in sessions})
    if len(people) != 1:
        raise InputError(
            f"--data: sessions of {len(people)} people ({', '.join(people[:4])}); give those of one wearer"
        )
    # Each session as somebody of its own: no window reaches from one into the next.
    streams = [
        replace(session.stream, subject=np.full(len(session.stream), place)) for place, session in enumerate(sessions)
    ]
    stream = join(streams)
    own = actions_of(replay_bundle(bundle, stream), np.zeros(len(stream), dtype=np.int64))[0]
    intercept, spread = posterior(own, bundle.person_spread)
    used = min(0.0, intercept)
    record = bundle.provenance
    if record is not None and bundle.doubt is None:
        adapted = {"actions": len(own.right), "intercept": round(used, 4), "files": len(sessions)}
        record = replace(record, figures={**record.figures, "adapted_to_one_wearer": adapted})
    careful = (
        replace(bundle, maps=shifted(bundle.maps, used), usual=_only_above(bundle.usual)) if used < 0.0 else bundle
    )
    written = save_bundle(replace(careful, provenance=record), out)
    return Adapted(people[0], len(own.right), int(own.right.sum()), intercept, spread, used, written)
