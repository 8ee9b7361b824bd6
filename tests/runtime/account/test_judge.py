"""runtime.judge: a decision against the wearer's ground truth, and no answer where nobody knows it."""

from __future__ import annotations

import pytest

from hilbridge.rows import GroundTruth
from hilbridge.runtime.account.judge import judge_by, judged
from hilbridge.verbs import VERBS
from hilbridge.wearer.person import Truth

POUR, MIX = VERBS.index("Pour"), VERBS.index("Mix")


@pytest.mark.parametrize(
    ("verb", "right"), [("Pour", True), ("Mix", True), ("Cut", False), ("Juggle", False), (None, None)]
)
def test_the_verb_under_way_and_the_one_in_preparation_are_right(verb: str | None, right: bool | None) -> None:
    mind = Truth(current=MIX, following=POUR, onset_ns=0, intended=POUR)
    assert judged(mind, verb) == GroundTruth("Pour", right)


def test_between_actions_no_verb_is_right() -> None:
    assert judged(Truth(None, POUR, 10, None), "Pour") == GroundTruth(None, False)


def test_where_nobody_knows_there_is_no_answer() -> None:
    assert judged(None, "Pour") is None


def test_a_wearers_time_begins_at_its_epoch_and_never_before() -> None:
    asked: list[int] = []
    judge = judge_by(lambda t_ns: asked.append(t_ns), 1000)
    judge(1500, None)
    judge(900, None)
    assert asked == [500, 0]
