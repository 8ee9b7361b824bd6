"""Labels laid over a stream follow the one rule of core.right."""

from __future__ import annotations

import numpy as np

from hilbridge.core.right import coming, is_right
from hilbridge.features.layout import STEP_NS, D
from hilbridge.learning.data.labelled import Spanned, labelled_stream

TAKE, PUT, CUT = 0, 1, 3


def stream(spans, steps=200, *, gaps_are_idle=False):
    return labelled_stream(
        1, spans, np.zeros((steps, D), np.float32), np.ones((steps, 3), bool), gaps_are_idle=gaps_are_idle
    )


def test_each_step_is_right_where_the_rule_says_so():
    spans = [Spanned(1000, 2000, TAKE), Spanned(2000, 4000, -1), Spanned(4000, 5000, PUT), Spanned(4600, 6000, CUT)]
    made = stream(spans)
    for step in range(200):
        now_ms = step * STEP_NS / 1e6
        under_way = [span.verb for span in spans if span.verb >= 0 and span.start_ms <= now_ms < span.end_ms]
        after = [span for span in spans if span.verb >= 0 and span.start_ms > now_ms]
        soon = coming(after[0].verb, round((after[0].start_ms - now_ms) * 1e6)) if after else None
        latest = under_way[-1] if under_way else None
        for verb in (TAKE, PUT, CUT, 7):
            got = bool(made.right(np.full(200, verb))[step])
            assert got == is_right(verb, latest, soon), (now_ms, verb)


def test_what_nobody_labelled_is_not_known_unless_gaps_are_idle():
    spans = [Spanned(1000, 2000, TAKE), Spanned(4000, 5000, PUT)]
    made = stream(spans)
    assert made.known.sum() == 50
    assert not made.known[60]
    whole = stream(spans, gaps_are_idle=True)
    assert whole.known[0:125].all()
    assert not whole.known[125:].any()
    assert not whole.right(np.full(200, TAKE))[60]


def test_labels_for_training_are_what_is_coming_then_what_is_under_way():
    made = stream([Spanned(1000, 4000, TAKE), Spanned(4000, 6000, PUT)])
    assert made.label[30] == TAKE
    assert made.label[74] == TAKE
    assert made.label[75] == PUT
    assert made.event[60] == 0
    assert made.event[75] == 1


def test_a_stream_without_labels_knows_nothing():
    made = stream([])
    assert not made.known.any()
    assert not made.right(np.full(200, TAKE)).any()
