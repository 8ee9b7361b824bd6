"""core.gate_figures and core.right: each figure by its one definition, and what must hold of any run."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.core.gate_figures import GateTick, gate_figures
from hilbridge.core.right import COMING_NS, coming, is_right

HOLD = GateTick(None, None)
TAKE, TAKE_WRONG, TAKE_UNKNOWN = GateTick("Take", True), GateTick("Take", False), GateTick("Take", None)
PUT_WRONG = GateTick("Put", False)


def test_an_episode_ends_with_a_hold_and_with_another_verb() -> None:
    figures = gate_figures([HOLD, TAKE, TAKE, PUT_WRONG, PUT_WRONG, HOLD, HOLD, TAKE])
    assert (figures.acts, figures.holds, figures.ticks, figures.act_ticks) == (3, 2, 8, 5)
    assert figures.false_assists == 1
    assert figures.false_assists_per_min(30.0) == 2.0


def test_an_episode_is_false_when_it_begins_wrong_whatever_comes_after() -> None:
    assert gate_figures([TAKE_WRONG, TAKE, TAKE, TAKE]).false_assists == 1
    assert gate_figures([TAKE, TAKE_WRONG, TAKE_WRONG]).false_assists == 0
    assert gate_figures([TAKE_UNKNOWN, TAKE_WRONG]).false_assists == 0


def test_precision_is_of_the_ticks_whose_truth_is_known() -> None:
    assert gate_figures([TAKE, TAKE_WRONG, TAKE_UNKNOWN, HOLD]).act_only_precision == 0.5
    assert gate_figures([TAKE_UNKNOWN, HOLD]).act_only_precision is None


def test_nothing_is_no_coverage_and_no_precision() -> None:
    figures = gate_figures([])
    assert (figures.coverage, figures.act_only_precision, figures.acts, figures.holds) == (0.0, None, 0, 0)
    assert figures.false_assists_per_min(0.0) == 0.0


TICKS = st.lists(
    st.one_of(st.just(HOLD), st.builds(GateTick, st.sampled_from("abc"), st.sampled_from([True, False, None])))
)


@given(TICKS)
def test_counts_of_any_run_fit_together(ticks: list[GateTick]) -> None:
    figures = gate_figures(ticks)
    assert figures.act_ticks + ticks.count(HOLD) == figures.ticks == len(ticks)
    assert figures.false_assists <= figures.acts <= figures.act_ticks
    assert figures.right_ticks <= figures.judged_ticks <= figures.act_ticks
    assert abs(figures.holds - figures.acts) <= max(1, figures.acts)
    assert 0.0 <= figures.coverage <= 1.0
    if ticks:
        assert figures.coverage == pytest.approx(figures.act_ticks / len(ticks))


def test_a_verb_is_right_under_way_or_prepared_and_idle_is_wrong() -> None:
    assert is_right(0, 0, None)
    assert is_right(1, 0, 1)
    assert not is_right(2, 0, 1)
    assert not is_right(0, None, None)


@pytest.mark.parametrize(
    ("until_ns", "expected"), [(-1, None), (0, 1), (COMING_NS, 1), (COMING_NS + 1, None), (None, None)]
)
def test_without_labels_of_preparation_a_verb_is_coming_for_a_second(
    until_ns: int | None, expected: int | None
) -> None:
    assert coming(1, until_ns) == expected
    assert coming(None, until_ns) is None
