"""What a latched device says it waits for: each step in turn, and never that a hand suffices when it does not."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.clearing import BRIDGE, HAND, HOLD, REST, awaited
from firmware_sim.law.memory import Torque
from firmware_sim.memory import ControllerState, Inputs
from firmware_sim.secoc import DEMO_KEY
from firmware_sim.states import State
from tests.safety.stepping import step


def stopped(**more: object) -> ControllerState:
    state = ControllerState(DEMO_KEY, 1, state=State.ESTOP, last_tick_ms=1000)
    return replace(state, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("state", "waits_for"),
    [
        (stopped(state=State.FOLLOW), None),
        (stopped(), BRIDGE),
        (stopped(clear_until_ms=1000), BRIDGE),
        (stopped(clear_until_ms=2000), HOLD),
        (stopped(clear_until_ms=2000, command_live=True), HOLD),
        (stopped(clear_until_ms=2000, command_live=True, command_is_hold=True, torque=Torque(assist_unm=5)), REST),
        (stopped(clear_until_ms=2000, command_live=True, command_is_hold=True), HAND),
        (stopped(state=State.LATCHED), BRIDGE),
    ],
)
def test_each_step_is_named_in_turn(state: ControllerState, waits_for: str | None) -> None:
    assert awaited(state, 1000) == waits_for


@given(
    st.sampled_from([State.LATCHED, State.ESTOP]),
    st.booleans(),
    st.booleans(),
    st.integers(900, 1100),
)
def test_a_hand_clears_when_it_is_what_is_waited_for_and_only_then(
    stop: State, live: bool, hold: bool, until_ms: int
) -> None:
    state = stopped(
        state=stop, command_live=live, command_is_hold=hold, clear_until_ms=until_ms, command_ms=1000, neutral=0
    )
    after, _ = step(state, Inputs(local_clear=True), 1001)
    assert (after.state is State.SELFTEST) == (awaited(state, 1001) == HAND)
