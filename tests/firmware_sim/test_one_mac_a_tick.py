"""A tick has time for one MAC: what else wants one in the same tick is refused, acts nothing, and is no wrong MAC (H1)."""

from __future__ import annotations

import pytest

from firmware_sim import frames, secoc
from firmware_sim.frames import Reject
from firmware_sim.memory import Received, Refusal
from firmware_sim.states import State
from tests.safety.hand import Hand

requirement = pytest.mark.requirement
WRONG_KEY = b"not the true key"


@pytest.fixture
def computed(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A number for each command of an ACT_AUTH that the reference computed a MAC for."""
    made: list[int] = []
    real = secoc.act_mac

    def counted(key: bytes, session: int, freshness: int, act_cmd: bytes) -> int:
        made.append(freshness)
        return real(key, session, freshness, act_cmd)

    monkeypatch.setattr(secoc, "act_mac", counted)
    return made


@requirement("P6", "S6")
def test_h1_the_second_authorisation_of_a_tick_acts_nothing_even_where_it_is_right() -> None:
    hand = Hand().to_ready()
    first, second = hand.act_cmd(frames.GATE_ACT, 1), hand.act_cmd(frames.GATE_ACT, 1)
    wrong, right = hand.auth(first, freshness=1, key=WRONG_KEY), hand.auth(second, freshness=1)
    hand.tick(first, wrong, second, right)
    assert (hand.state.state, hand.state.freshness, hand.state.pending) == (State.READY, 0, None)
    assert (hand.count(Reject.MAC), hand.count(Reject.AUTH_UNPAIRED), hand.state.mac_failures) == (1, 1, 1)
    hand.run(40)
    again = hand.act_cmd(frames.GATE_ACT, 1)
    hand.tick(again, hand.auth(again, freshness=1))  # what was not looked at is not used up
    assert hand.state.state is State.ASSIST


@requirement("P6", "S6")
def test_h1_two_pairs_of_one_tick_are_an_act_and_a_hold() -> None:
    hand = Hand().to_ready()
    hand.tick(*hand.act(), *hand.act())
    assert hand.state.state is not State.ASSIST
    assert (hand.count(Reject.AUTH_UNPAIRED), hand.count(Reject.AUTH_MISSING)) == (1, 1)
    hand.run(39)
    hand.tick(*hand.act())
    hand.run(60)
    hand.tick(*hand.act())
    assert hand.state.state is State.ASSIST


@requirement("P6")
def test_pairs_of_two_ticks_are_both_looked_at() -> None:
    hand = Hand().to_ready()
    for freshness in (1, 2):
        hand.tick(*hand.act())
        assert (hand.state.state, hand.state.freshness) == (State.ASSIST, freshness)


@requirement("P6")
def test_authorisations_that_nothing_is_computed_for_leave_the_tick_its_mac() -> None:
    hand = Hand().to_ready()
    lone = hand.auth(hand.act_cmd(frames.GATE_ACT, 1), freshness=1, key=WRONG_KEY)
    hand.run(20)
    hand.tick(lone, *hand.act())  # no command of the last 10 ms: nothing that it could be for
    assert hand.state.state is State.ASSIST


@requirement("P6", "S6")
def test_h1_a_flood_of_guesses_takes_one_mac_a_tick(computed: list[int]) -> None:
    hand = Hand().to_ready()
    pairs: list[Received] = []
    for _ in range(4):
        command = hand.act_cmd(frames.GATE_ACT, 1)
        pairs += [command, hand.auth(command, freshness=1, key=WRONG_KEY)]
    computed.clear()
    hand.tick(*pairs)
    assert len(computed) <= 1  # none where the C computes
    assert hand.state.mac_failures == 1
    assert (hand.count(Reject.MAC), hand.count(Reject.AUTH_UNPAIRED)) == (1, 3)


@requirement("P6", "S6")
def test_h1_guesses_in_three_ticks_latch() -> None:
    hand = Hand().to_ready()
    for failures in (1, 2, 3):
        command = hand.act_cmd(frames.GATE_ACT, 1)
        hand.tick(command, *(hand.auth(command, freshness=1, key=WRONG_KEY) for _ in range(3)))
        assert hand.state.mac_failures == failures
    assert hand.state.state is State.LATCHED


@requirement("P6")
def test_a_response_after_the_mac_of_its_tick_is_told_as_disturbed_and_its_challenge_stands() -> None:
    hand = Hand().to_ready()
    session = hand.state.session
    hand.tick(hand.request())
    command = hand.act_cmd(frames.GATE_ACT, 1)
    hand.tick(command, hand.auth(command, key=WRONG_KEY), hand.response())
    assert (hand.state.session, hand.state.refusal) == (session, Refusal.DISTURBED)
    assert (hand.count(Reject.HANDSHAKE), hand.state.mac_failures) == (1, 1)
    hand.tick(hand.response())
    assert (hand.state.session, hand.state.refusal) == (session + 1, Refusal.NONE)


@requirement("P6", "S6")
def test_h1_an_authorisation_after_a_response_of_its_tick_acts_nothing() -> None:
    hand = Hand().to_ready()
    hand.tick(hand.request())
    command = hand.act_cmd(frames.GATE_ACT, 1)
    right = hand.auth(command)
    hand.tick(hand.response(shared=WRONG_KEY), command, right)
    assert hand.state.state is State.READY
    assert (hand.count(Reject.MAC), hand.count(Reject.AUTH_UNPAIRED)) == (1, 1)


@requirement("P6", "S6")
def test_h1_of_two_handshakes_in_one_tick_one_is_tried() -> None:
    hand = Hand().to_follow()
    wrong = hand.response(session=1, shared=WRONG_KEY)
    hand.tick(hand.request(), wrong, hand.request(), hand.response(session=2))
    assert not hand.state.armed
    assert (hand.state.mac_failures, hand.state.refusal) == (1, Refusal.DISTURBED)
    hand.tick(hand.response())
    assert hand.state.armed
