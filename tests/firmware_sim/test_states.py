"""The transition table: total, default deny, and drawn in the docs as it is."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import cantools
import pytest

from firmware_sim import selftest
from firmware_sim.diagram import diagram
from firmware_sim.states import TABLE, Event, Reason, State, next_state, wire_name

requirement = pytest.mark.requirement
DOCS = Path(__file__).parents[2] / "docs" / "controller-states.md"
DBC = Path(__file__).parents[2] / "dbc" / "iassistadl.dbc"


@requirement("S1")
def test_the_table_covers_every_state_and_event() -> None:
    assert set(TABLE) == set(State)
    for state, event in product(State, Event):
        assert next_state(state, event) in State


@requirement("S1", "S3", "S5")
@pytest.mark.parametrize(("state", "event"), list(product(State, Event)))
def test_h1_only_an_authorised_act_in_ready_leads_to_assist(state: State, event: Event) -> None:
    leads = next_state(state, event) == State.ASSIST and state != State.ASSIST
    assert leads == (state == State.READY and event == Event.ACT)


@requirement("S1", "S7", "P3")
@pytest.mark.parametrize("event", list(Event))
def test_h2_only_clear_leaves_a_latch_and_stop_wins_everywhere(event: Event) -> None:
    for state in (State.LATCHED, State.ESTOP):
        if event not in (Event.CLEAR, Event.STOP):
            assert next_state(state, event) == state
        assert next_state(state, Event.CLEAR) == State.SELFTEST
    for state in State:
        assert next_state(state, Event.STOP) == State.ESTOP
        if state != State.ESTOP:
            assert next_state(state, Event.LATCH) == State.LATCHED


@requirement("S1")
def test_the_table_is_exactly_this() -> None:
    moves = {(s.name, e.name): t.name for s, row in TABLE.items() for e, t in row.items() if t != s}
    expected = {
        ("BOOT", "BOOTED"): "SELFTEST",
        ("SELFTEST", "SELFTEST_PASSED"): "FOLLOW",
        ("FOLLOW", "NEUTRAL"): "READY",
        ("READY", "ACT"): "ASSIST",
        ("READY", "FAULT"): "FOLLOW",
        ("ASSIST", "VERB_CHANGE"): "RAMP_DOWN",
        ("ASSIST", "HOLD"): "RAMP_DOWN",
        ("ASSIST", "FAULT"): "RAMP_DOWN",
        ("RAMP_DOWN", "RAMPED_CLEAN"): "READY",
        ("RAMP_DOWN", "RAMPED_FAULT"): "FOLLOW",
        ("PASSIVE", "SENSORS_GOOD"): "FOLLOW",
        ("LATCHED", "CLEAR"): "SELFTEST",
        ("ESTOP", "CLEAR"): "SELFTEST",
    }
    for name in ("SELFTEST", "FOLLOW", "READY", "ASSIST", "RAMP_DOWN"):
        expected[name, "SENSORS_BAD"] = "PASSIVE"
    for name in ("BOOT", "SELFTEST", "FOLLOW", "READY", "ASSIST", "RAMP_DOWN", "PASSIVE"):
        expected[name, "LATCH"] = "LATCHED"
    for name in ("BOOT", "SELFTEST", "FOLLOW", "READY", "ASSIST", "RAMP_DOWN", "PASSIVE", "LATCHED"):
        expected[name, "STOP"] = "ESTOP"
    assert moves == expected


def test_the_diagram_in_the_docs_is_the_table() -> None:
    assert f"```mermaid\n{diagram()}```" in DOCS.read_text(encoding="utf-8"), (
        "docs/controller-states.md is out of date: paste the output of `python -m firmware_sim.diagram`"
    )


def test_codes_on_the_wire_are_those_of_the_dbc() -> None:
    from hilbridge.wire.codec import Codec

    status = {signal.name: signal for signal in Codec().messages["CTRL_STATUS"].signals}
    assert status["State"].names is not None
    assert status["Reason"].names is not None
    for enum, names in ((State, status["State"].names), (Reason, status["Reason"].names)):
        assert {entry.value: entry.name.replace("_", "").lower() for entry in enum} == {
            code: name.lower() for code, name in names.items()
        }


@requirement("S6")
@pytest.mark.parametrize("broken", ["crc16", "cmac", "TABLE"])
def test_self_test_notices_a_broken_part(broken: str, monkeypatch: pytest.MonkeyPatch) -> None:
    selftest.passed.cache_clear()
    assert selftest.passed()
    selftest.passed.cache_clear()
    part = {
        "crc16": lambda data: 0,
        "cmac": lambda key, message: b"",
        "TABLE": {**TABLE, State.BOOT: {}},
    }[broken]
    monkeypatch.setattr(selftest, broken, part)
    assert not selftest.passed()
    selftest.passed.cache_clear()


@pytest.mark.parametrize(("signal", "members"), [("State", State), ("Reason", Reason)])
def test_logs_use_the_words_of_the_dbc(signal: str, members: type[State] | type[Reason]) -> None:
    status = cantools.database.load_file(DBC).get_message_by_name("CTRL_STATUS")
    names = status.get_signal_by_name(signal).choices
    assert {member.value: wire_name(member) for member in members} == {
        value: str(name) for value, name in names.items()
    }
