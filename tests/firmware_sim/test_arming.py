"""Arming at the device: request, challenge, response."""

from __future__ import annotations

import pytest

from firmware_sim import frames
from firmware_sim.frames import Reject
from firmware_sim.states import Reason, State
from tests.safety.hand import Hand

requirement = pytest.mark.requirement
CLEAR = frames.PURPOSE_CLEAR_LATCH


@requirement("P6")
@pytest.mark.parametrize(
    ("state", "purpose", "answered"),
    [
        (State.FOLLOW, frames.PURPOSE_ARM, True),
        (State.READY, frames.PURPOSE_ARM, True),
        (State.FOLLOW, CLEAR, False),
        (State.ASSIST, frames.PURPOSE_ARM, False),
        (State.ASSIST, CLEAR, False),
        (State.LATCHED, frames.PURPOSE_ARM, False),
        (State.LATCHED, CLEAR, True),
        (State.ESTOP, CLEAR, True),
        (State.ESTOP, frames.PURPOSE_ARM, False),
        (State.PASSIVE, frames.PURPOSE_ARM, False),
    ],
)
def test_a_request_is_answered_only_where_it_makes_sense(state: State, purpose: int, answered: bool) -> None:
    hand = Hand().to_follow()
    hand.state.state = state
    hand.log.clear()
    hand.tick(hand.request(purpose))
    challenged = [data for can_id, data in hand.log if can_id == frames.ARM_CHALLENGE]
    assert (len(challenged) == 1) == answered
    assert hand.count(Reject.HANDSHAKE) == (0 if answered else 1)
    assert (hand.state.challenge is not None) == answered
    if answered:
        why, values = frames.unpack(frames.ARM_CHALLENGE, challenged[0])
        assert (why, values) == (Reject.ACCEPTED, (0x55667788, 1))


@requirement("P6")
def test_a_request_alone_ends_no_session() -> None:
    hand = Hand().to_ready()
    session = hand.state.session
    hand.tick(hand.request())
    assert hand.state.armed
    assert hand.state.session == session
    assert hand.state.state == State.READY


@requirement("P6")
def test_arming_anew_ends_the_old_session_and_neutral() -> None:
    hand = Hand().to_ready()
    old, old_key = hand.state.session, hand.state.key
    hand.beat(*hand.act(), milliseconds=1)
    hand.beat(hand.hold())
    assert hand.state.state == State.READY
    assert hand.state.freshness == 1
    hand.arm()
    assert hand.state.session == old + 1
    assert hand.state.key != old_key
    assert hand.state.freshness == 0
    assert hand.state.state == State.FOLLOW
    assert hand.state.reason == Reason.DISARMED
    assert hand.state.heartbeat_ms == hand.now_ms
    assert hand.state.neutral == 0
    assert hand.state.pending is None


@requirement("P6")
def test_arming_forgets_an_act_that_waits_and_the_neutral_of_before() -> None:
    hand = Hand().to_follow()
    for _ in range(4):
        hand.beat(hand.hold())
    hand.arm().beat(hand.hold())
    assert hand.state.neutral == 1
    hand.tick(hand.request())
    response = hand.response()
    hand.tick(hand.act_cmd(frames.GATE_ACT, 1))
    assert hand.state.pending is not None
    hand.tick(response)
    assert hand.state.pending is None
    assert hand.state.neutral == 0


@requirement("P6")
@pytest.mark.parametrize(("wait_ms", "armed"), [(499, True), (500, True), (501, False)])
def test_a_challenge_waits_half_a_second(wait_ms: int, armed: bool) -> None:
    hand = Hand().to_follow()
    hand.tick(hand.request())
    response = hand.response()
    hand.run(wait_ms - 1)
    hand.tick(response)
    assert hand.state.armed == armed
    assert hand.count(Reject.HANDSHAKE) == (0 if armed else 1)


@requirement("P6")
@pytest.mark.parametrize("broken", ["none_asked", "session", "twice"])
def test_responses_nobody_waits_for_are_counted(broken: str) -> None:
    hand = Hand().to_follow()
    if broken == "none_asked":
        hand.tick(hand.response(session=1))
    else:
        hand.tick(hand.request())
        hand.tick(hand.response(session=2 if broken == "session" else None))
        if broken == "twice":
            hand.tick(hand.response())
    assert hand.count(Reject.HANDSHAKE) == 1
    assert hand.state.mac_failures == 0
    assert hand.state.armed == (broken == "twice")


@requirement("P6", "S6")
def test_three_wrong_responses_latch() -> None:
    hand = Hand().to_follow()
    for failures in (1, 2, 3):
        hand.tick(hand.request())
        hand.tick(hand.response(shared=b"z" * 16))
        assert hand.state.mac_failures == failures
        assert hand.state.challenge is None
        assert not hand.state.armed
    assert hand.state.state == State.LATCHED


@requirement("P6")
def test_an_assist_that_began_meanwhile_keeps_its_session() -> None:
    hand = Hand().to_ready()
    hand.tick(hand.request())
    response = hand.response()
    session, key = hand.session, hand.state.key
    hand.tick(*hand.act())
    hand.tick(response)
    assert hand.state.state == State.ASSIST
    assert (hand.state.session, hand.state.key) == (session, key)


@requirement("P6")
def test_session_numbers_run_from_1_to_255_and_around() -> None:
    hand = Hand().to_follow()
    seen = []
    for _ in range(257):
        hand.tick(hand.request())
        seen.append(hand.state.last_session)
    assert seen == [*range(1, 256), 1, 2]
