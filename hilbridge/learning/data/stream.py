"""One person's stream of feature vectors with what is true at each, as training and replay take it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Stream:
    """One person's features at 25 Hz and what was really going on.

    values (N, D) float32 raw; valid (N, 3) bool; label (N,) the intended verb, or the following one when idle;
    current (N,) the verb under way or -1; event (N,) the action that `label` belongs to, -1 idle; busy_steps (N,) steps
    since the intention formed, -1 idle; onset_steps (N,) steps until the following action begins; bayes (N, K) the best
    possible belief given what the event shows (the prior when idle).
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

    def __len__(self) -> int:
        return len(self.label)


def join(streams: Iterable[Stream]) -> Stream:
    """Several people one after the other (a window must not cross from one to the next: see `subject`)."""
    parts = list(streams)
    return Stream(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Stream)))
