"""Judges decisions by what the wearer really wants, where that is known: simulated wearers know it. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from hilbridge.verbs import VERBS

# (now_ns, index of the decision's verb) -> entries of the tick's row.
Judge = Callable[[int, int | None], Mapping[str, Any]]


class Mind(Protocol):
    """What is known of a wearer's intention at one moment: `wearer.person.Truth`, or that nothing is known."""

    @property
    def intended(self) -> int | None: ...

    def is_right(self, verb_index: int) -> bool | None: ...


def judged(mind: Mind, verb_index: int | None) -> dict[str, Any]:
    """The ground truth of one tick and whether the decision's verb is right; None where that has no answer."""
    return {
        "truth": None if mind.intended is None else VERBS[mind.intended],
        "right": None if verb_index is None else mind.is_right(verb_index),
    }


def judge_by(truth: Callable[[int], Mind], epoch_ns: int) -> Judge:
    """A judge by a wearer whose time begins at `epoch_ns` of the bridge's clock; `truth` takes the wearer's time."""
    return lambda now_ns, verb_index: judged(truth(max(0, now_ns - epoch_ns)), verb_index)
