"""What bridges ask for: the gate in question, an ACT at every tick, and the twin without what was wrong."""

from __future__ import annotations

from dataclasses import replace

import pytest

from hilbridge.confidence import ALL_VALID
from hilbridge.records import Action, HoldReason
from hilbridge.rows import TickRow
from hilbridge.verbs import VERBS
from hilscenario.benefit.gates import Gate, Order, always, decided, orders, parts_for, without_wrong
from hilscenario.benefit.visits import Visit, wearer_of
from hilscenario.world.parts import parts_of
from tests.scenarios.made import scenario

VISIT = Visit(0, 0, 10.0)
WEARER = wearer_of(VISIT)
BUSY = next(one for one in WEARER.events(60_000_000_000) if VERBS[one.verb] not in ("Move Around", "other"))


def _row(time_ns: int, verb: str | None, top: str | None) -> TickRow:
    action = Action.HOLD if verb is None else Action.ACT
    return TickRow(time_ns, action, HoldReason.NONE, 0.9, verb=verb, top_verb=top)


def test_without_calibration_a_number_means_itself_whatever_the_tremor() -> None:
    parts = parts_for(Gate("raw", 1.0), scenario())
    assert {parts.gate.maps.confidence(0.8, ALL_VALID | level << 3) for level in range(4)} == {0.8}
    assert set(parts.bundle.temperatures.values()) == {1.0}
    assert parts.gate.tau_on == parts_of(scenario()).gate.tau_on


def test_the_calibrated_gate_is_the_one_that_ships_and_a_threshold_keeps_its_band() -> None:
    shipped = parts_of(scenario())
    assert parts_for(Gate("calibrated"), scenario()) == shipped
    lower = parts_for(Gate("lower", tau_on=0.6), scenario()).gate
    assert lower.tau_on - lower.tau_off == pytest.approx(shipped.gate.tau_on - shipped.gate.tau_off)
    assert replace(lower, tau_on=shipped.gate.tau_on, tau_off=shipped.gate.tau_off) == shipped.gate


def test_what_was_asked_is_right_while_the_wearer_wants_it() -> None:
    now_ns, name = BUSY.start_ns + 1, VERBS[BUSY.verb]
    wrong = next(verb for verb in VERBS if not WEARER.truth(now_ns).is_right(VERBS.index(verb)))
    rows = [_row(now_ns, name, name), _row(now_ns, None, wrong), _row(now_ns, None, "Move Around")]
    assert [(one.verb, one.right) for one in orders(rows, WEARER)] == [(BUSY.verb, True), (None, None), (None, None)]
    asked = always(rows, WEARER)
    assert [one.right for one in asked] == [True, False, None]
    assert without_wrong(asked) == [asked[0], Order(asked[1].at_ms, None, None), asked[2]]


def test_a_bridge_decides_25_times_a_second_on_the_person_who_came() -> None:
    rows = decided(Visit(0, 0, 2.0), Gate("raw", 1.0))
    assert 48 <= len(rows) <= 50
    assert {row.truth_known for row in rows} == {True}
