"""Spans of labels laid over a stream of features: one rule for every kind of session, see `hilbridge.core.right`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hilbridge.core.right import COMING_NS
from hilbridge.features.layout import STEP_NS
from hilbridge.learning.data.stream import Stream
from hilbridge.verbs import VERBS

COMING_STEPS = COMING_NS // STEP_NS


class Spanned(NamedTuple):
    """What somebody says the wearer did; times are ms of the stream. verb: class index, -1 for nothing at all."""

    start_ms: float
    end_ms: float
    verb: int


def labelled_stream(
    subject: int,
    spans: Sequence[Spanned],
    values: NDArray[np.float32],
    valid: NDArray[np.bool_],
    *,
    gaps_are_idle: bool,
    verbs: int = len(VERBS),
) -> Stream:
    """A session's stream; `spans` in order of their start.

    gaps_are_idle: whoever annotated wrote down every action, so between the first and the last nothing else was done; else
    what no span covers is not known. verbs: K. Of two actions at once the later begun is under way.
    """
    steps = len(values)
    at = np.arange(steps)
    current, owner = np.full(steps, -1), np.full(steps, -1)
    known = np.zeros(steps, dtype=bool)
    for index, span in enumerate(spans):
        begin, end = (min(steps, max(0, _step(time_ms))) for time_ms in (span.start_ms, span.end_ms))
        known[begin:end] = True
        current[begin:end] = span.verb
        owner[begin:end] = index if span.verb >= 0 else -1
    actions = [(index, span) for index, span in enumerate(spans) if span.verb >= 0]
    onsets = np.array([_step(span.start_ms) for _, span in actions], dtype=np.int64)
    if gaps_are_idle and len(onsets):
        known[max(0, onsets[0] - COMING_STEPS) : max(0, _step(max(span.end_ms for _, span in actions)))] = True
    if not len(onsets):
        following, until = np.full(steps, -1), np.full(steps, -1)
        number = np.full(steps, -1)
    else:
        place = np.minimum(np.searchsorted(onsets, at, side="right"), len(onsets) - 1)
        following, until = np.array([span.verb for _, span in actions])[place], onsets[place] - at
        number = np.array([index for index, _ in actions])[place]
    coming = (until >= 0) & (until <= COMING_STEPS)
    return Stream(
        np.full(steps, subject),
        values,
        valid,
        np.where(coming | (current < 0), following, current),
        current,
        np.where(coming, number, owner),
        np.full(steps, -1),
        until,
        np.zeros((steps, verbs), dtype=np.float32),
        known,
    )


def _step(time_ms: float) -> int:
    return round(time_ms * 1e6 / STEP_NS)
