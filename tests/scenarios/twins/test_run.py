"""Twins: nothing changed is no difference at all; a false ACT is one, and a small one."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from hilbridge.errors import InputError
from hilscenario.twins.page import as_json, draw, worst
from hilscenario.twins.run import Body, Trace, body_of, cases, compare, difference, trace, verbs_of

BODY = Body("weak", "cerebellar")
PAIRS = {pair.event: pair for pair in cases(1, BODY, ("Pour",))}


def _shortened(event: str) -> tuple[Trace, Trace]:
    pair = PAIRS[event]
    action = replace(pair.action, end_ns=pair.action.start_ns + 800_000_000)
    one, other = (trace(pair.seed, pair.body, action, ask) for ask in (pair.run, pair.twin))
    return one, other


def test_the_four_events() -> None:
    assert list(PAIRS) == ["false ACT", "wrong verb", "missed assist", "dropout mid-pour"]


def test_a_run_beside_itself_differs_in_nothing() -> None:
    run, _ = _shortened("missed assist")
    found = difference(run, run)
    assert (found.work_j, found.hand_mm, found.torque_nm, found.tremor) == (0.0, 0.0, 0.0, 1.0)


def test_a_false_act_moves_a_hand_and_stays_below_the_bar(tmp_path: Path) -> None:
    pair = PAIRS["false ACT"]
    run, twin = _shortened("false ACT")
    begins = pair.run.from_ms if pair.run is not None else 0
    assert run.hand[:begins] == twin.hand[:begins]
    found = difference(run, twin)
    assert 0.0 < found.hand_mm <= 30.0
    assert found.work_j <= 0.1
    assert worst([(pair, found)])[0][:2] == ("false ACT", "1")
    assert json.loads(as_json([(pair, found)]))[0]["seed"] == 1
    draw(pair, run, twin, tmp_path / "one.png")
    assert (tmp_path / "one.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    "wrong", [("steadier", "none", "soft"), ("steady", "nobody", "soft"), ("steady", "none", "hard")]
)
def test_names_that_nobody_knows_are_one_line(wrong: tuple[str, str, str]) -> None:
    with pytest.raises(InputError, match="there are"):
        body_of(*wrong, None)


def test_a_verb_that_is_never_assisted_is_refused() -> None:
    with pytest.raises(InputError, match="--verb Move Around"):
        verbs_of(["Move Around"])


def test_compare_runs_both() -> None:
    pair = replace(PAIRS["missed assist"], run=None, twin=None, action=replace(PAIRS["missed assist"].action))
    short = replace(pair, action=replace(pair.action, end_ns=pair.action.start_ns + 200_000_000))
    assert compare(short)[0].hand_mm == 0.0
