"""Orders on the worn arm: the controller's own table decides, and what is left of an ACT is that ACT's."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_sim.memory import ControllerState
from firmware_sim.states import State
from firmware_sim.watchdogs import NEUTRAL_HOLDS
from hilbridge.verbs import VERBS
from hilscenario.benefit.gates import Order
from hilscenario.benefit.played import NO_ACT, RIGHT, WRONG, Ordered, play
from hilscenario.benefit.visits import Visit

POUR, TAKE = VERBS.index("Pour"), VERBS.index("Take")


def _ready() -> tuple[ControllerState, Ordered]:
    state = ControllerState(bytes(16), 1)
    state.state = State.FOLLOW
    ordered = Ordered(state)
    for _ in range(NEUTRAL_HOLDS):
        assert state.state is State.FOLLOW
        ordered.tell(Order(0, POUR, True), 1)  # a device that follows is not asked to act
    return state, ordered


def test_three_holds_make_it_ready_and_an_act_assists() -> None:
    state, ordered = _ready()
    assert (state.state, ordered.effect()) == (State.READY, NO_ACT)
    ordered.tell(Order(0, POUR, True), 2)
    assert (state.state, state.verb, ordered.effect()) == (State.ASSIST, POUR + 1, RIGHT)
    ordered.tell(Order(0, POUR, False), 3)
    assert ordered.effect() == WRONG


@pytest.mark.parametrize("verb", [None, TAKE])
def test_a_hold_and_another_verb_ramp_down(verb: int | None) -> None:
    state, ordered = _ready()
    ordered.tell(Order(0, POUR, False), 2)
    ordered.tell(Order(0, verb, None), 3)
    assert (state.state, ordered.effect()) == (State.RAMP_DOWN, WRONG)
    state.state = State.READY
    state.torque.gravity_unm = 1  # support outlives the ramp
    assert ordered.effect() == WRONG
    state.torque.gravity_unm = 0
    assert ordered.effect() == NO_ACT


def test_one_session_with_and_without_orders_is_the_same_until_the_first_act() -> None:
    visit = Visit(1, 0, 1.2)
    holds = [Order(at, None, None) for at in range(100, 500, 40)]
    acts = [Order(at, POUR, True) for at in range(500, 1_200, 40)]
    off, asked = play(visit, ()), play(visit, holds + acts)
    assert np.array_equal(off.hand[:500], asked.hand[:500])
    assert not np.array_equal(off.hand, asked.hand)
    assert (off.effect == NO_ACT).all()
    assert set(asked.effect[505:].tolist()) == {RIGHT}
    assert not off.power.any()
    assert asked.power.any()
    assert not off.latched
