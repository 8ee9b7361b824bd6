"""One person's stream of feature vectors with what is true at each, as training and replay take it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Stream:
    """One person's features at 25 Hz and what was really going on.

    values (N, D) float32 raw; valid (N, 3) bool; label (N,) the prepared verb, else the one under way, else the following
    one; current (N,) the verb under way or -1; event (N,) the action that `label` belongs to, -1 idle; busy_steps (N,) steps
    since the intention formed, -1 idle; onset_steps (N,) steps until the following action begins; bayes (N, K) the best
    possible belief given what the event shows (the prior when idle); known (N,) whether somebody knows all this.
    """

    subject: NDArray[np.int64]
    values: NDArray[np.float32]
    valid: NDArray[np.bool_]
    label: NDArray[np.int64]
    current: NDArray[np.int64]
    event: NDArray[np.int64]
    busy_steps: NDArray[np.int64]
    onset_steps: NDArray[np.int64]
    bayes: NDArray[np.float32]
    known: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.label)

    @property
    def verbs(self) -> int:
        """K."""
        return int(self.bayes.shape[1])

    def right(self, verb: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(N,) whether `verb` (N,) is right at each step: `core.right` over arrays, -1 for nothing; tests compare."""
        prepared = np.where(self.event >= 0, self.label, -1)
        return np.asarray((verb >= 0) & ((verb == self.current) | (verb == prepared)))

    def part(self, where: NDArray[np.bool_]) -> Stream:
        """The steps of some people: `where` (N,) is true for all of a person or none."""
        return Stream(*(getattr(self, field.name)[where] for field in fields(Stream)))


def join(streams: Iterable[Stream]) -> Stream:
    """Several people one after the other (a window must not cross from one to the next: see `subject`)."""
    parts = list(streams)
    return Stream(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Stream)))
