"""Judges decisions by what the wearer really wants, where that is known: simulated wearers know it. Pure."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from hilbridge.rows import GroundTruth
from hilbridge.verbs import VERBS

# (now_ns, the decision's verb) -> what is true then; None where nobody knows.
Judge = Callable[[int, str | None], GroundTruth | None]


class Mind(Protocol):
    """What is known of a wearer's intention at one moment (`wearer.person.Truth`)."""

    @property
    def intended(self) -> int | None: ...

    def is_right(self, verb_index: int) -> bool: ...


def judged(mind: Mind | None, verb: str | None) -> GroundTruth | None:
    """The ground truth of one tick, and whether the decision's verb is right; None where the intention is not known.

    Simulated wearers have the default vocabulary; a verb of another is never theirs.
    """
    if mind is None:
        return None
    intended = None if mind.intended is None else VERBS[mind.intended]
    return GroundTruth(intended, None if verb is None else verb in VERBS and mind.is_right(VERBS.index(verb)))


def judge_by(truth: Callable[[int], Mind | None], epoch_ns: int) -> Judge:
    """A judge by a wearer whose time begins at `epoch_ns` of the bridge's clock; `truth` takes the wearer's time."""
    return lambda now_ns, verb: judged(truth(max(0, now_ns - epoch_ns)), verb)
