"""A constant offset between two rows of moments that belong together, though either lacks some and has others. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hilbridge.errors import InputError
from hilbridge.limits import MS

WIDEST_NS = 900 * MS
_TOGETHER_NS = 40 * MS  # pairs of one offset lie no further from it
FEWEST = 3
_CLEAR = 0.7  # another offset that so many of the pairs speak for, makes both doubtful
WIDEST_SPREAD_NS = 25 * MS


@dataclass(frozen=True, slots=True)
class Offset:
    """By how much the second row is later; its pairs; the median distance of pairs from it."""

    offset_ns: int
    pairs: int
    spread_ns: int

    @property
    def error_ns(self) -> int:
        """How far the median may be off by the pairs' own scatter: a standard error, from the median distance."""
        return round(1.4826 * 1.2533 * self.spread_ns / math.sqrt(self.pairs))


def constant_offset(
    first_ns: NDArray[np.int64], second_ns: NDArray[np.int64], expected_ns: int = 0, names: str = "events"
) -> Offset:
    """The offset that most pairs agree on, within `WIDEST_NS` of what is expected.

    Raises InputError where there are too few, where two offsets are equally likely, or where pairs scatter too far.
    """
    apart = (second_ns[None, :] - first_ns[:, None]).ravel()
    apart = np.sort(apart[np.abs(apart - expected_ns) <= WIDEST_NS])
    if len(apart) < FEWEST:
        raise InputError(
            f"align: {len(first_ns)} and {len(second_ns)} {names} found, {FEWEST} pairs are due; do it again more clearly"
        )
    support = np.array([_near(apart, one) for one in apart.tolist()])
    best = int(apart[int(np.argmax(support))])
    agreed = apart[np.abs(apart - best) <= _TOGETHER_NS]
    offset_ns = int(np.median(agreed))
    due = max(FEWEST, -(-min(len(first_ns), len(second_ns)) // 2))
    if len(agreed) < due:
        raise InputError(f"align: only {len(agreed)} {names} agree, {due} are due; do it again more clearly")
    rival = max(
        (count for one, count in zip(apart, support, strict=True) if abs(one - best) > 2 * _TOGETHER_NS), default=0
    )
    if rival > _CLEAR * len(agreed):
        raise InputError(
            f"align: two offsets are equally likely ({len(agreed)} and {rival} {names}); do it again in no regular rhythm"
        )
    spread_ns = int(np.median(np.abs(agreed - offset_ns)))
    if spread_ns > WIDEST_SPREAD_NS:
        raise InputError(f"align: {names} scatter by {spread_ns / MS:.0f} ms; do it again more clearly")
    return Offset(offset_ns, len(agreed), spread_ns)


def _near(apart: NDArray[np.int64], one: int) -> int:
    low, high = np.searchsorted(apart, [one - _TOGETHER_NS, one + _TOGETHER_NS + 1]).tolist()
    return int(high) - int(low)
