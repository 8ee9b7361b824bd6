"""Rare ways through the controller that no other test takes: each held to the same in both controllers."""

from __future__ import annotations

from dataclasses import replace

from firmware_sim import frames
from firmware_sim.law.guidance import CONTACT_TICKS, GUIDE_UNM
from firmware_sim.memory import COUNT_TRIPS, Received
from firmware_sim.states import Reason, State
from firmware_sim.watchdogs import AUTH_LIMIT_MS
from tests.safety.hand import TAKE, Hand

OPEN = 3


def spoilt(frame: Received) -> Received:
    return frame._replace(data=bytes((frame.data[0] ^ 1, *frame.data[1:])))


def test_an_assist_that_began_meanwhile_keeps_its_session() -> None:
    """A challenge is answered when an ACT has been taken already."""
    hand = Hand().to_ready()
    session, key = hand.session, hand.key
    hand.beat(hand.request(), hand.hold())
    hand.beat(*hand.act(TAKE))
    assert hand.state.state is State.ASSIST
    hand.tick(hand.response())
    assert hand.state.state is State.ASSIST
    assert (hand.state.session, hand.state.key) == (session, key)


def test_an_authorisation_in_the_tick_after_its_limit_finds_a_hold() -> None:
    hand = Hand().to_ready()
    command, authorisation = hand.act(TAKE)
    hand.tick(command)
    hand.run(AUTH_LIMIT_MS)
    assert hand.count(frames.Reject.AUTH_MISSING) == 0
    hand.tick(authorisation)
    assert hand.state.state is State.READY
    assert hand.count(frames.Reject.AUTH_MISSING) == 1
    assert hand.count(frames.Reject.AUTH_UNPAIRED) == 0


def test_a_trip_on_the_way_out_of_a_fault_does_not_matter_again() -> None:
    """Stale sensing is a fault and no trip; what makes the E2E machine invalid during its ramp is none either."""
    hand = Hand().to_assist()
    hand.tick(hand.hold(age=80))
    assert (hand.state.state, hand.state.ramp_fault) == (State.RAMP_DOWN, True)
    for _ in range(3):
        hand.tick(spoilt(hand.hold()))
    assert hand.state.state is State.RAMP_DOWN
    assert hand.state.reason is Reason.E2E_INVALID
    assert hand.count(COUNT_TRIPS) == 0


def test_an_angle_out_of_this_world_on_both_encoders_is_implausible() -> None:
    hand = Hand().to_follow()
    hand.inputs = replace(hand.inputs, angle_mdeg=-41_000, second_angle_mdeg=-41_000, velocity_mdeg_s=0)
    hand.run(4)
    assert hand.state.state is State.PASSIVE
    hand = Hand().to_follow()
    hand.inputs = replace(hand.inputs, angle_mdeg=201_000, second_angle_mdeg=201_000, velocity_mdeg_s=0)
    hand.run(4)
    assert hand.state.state is State.PASSIVE


def test_guidance_until_contact_ends_with_it_and_fades_once() -> None:
    hand = Hand().to_ready()
    hand.inputs = replace(hand.inputs, user_torque_unm=1_500_000, velocity_mdeg_s=25_000)
    for _ in range(12):
        hand.beat(*hand.act(OPEN))
    assert hand.state.torque.guide_unm == GUIDE_UNM
    hand.inputs = replace(hand.inputs, velocity_mdeg_s=0)  # something is in the way
    for _ in range(12):
        hand.beat(*hand.act(OPEN))
    law = hand.state.torque
    assert (law.guide_unm, law.guide_tick, law.fade_ticks, law.onset_ticks) == (0, 0, 0, 0)
    assert CONTACT_TICKS < law.contact_ticks < CONTACT_TICKS + 200


def test_guidance_that_has_begun_to_fade_ends_though_the_way_is_free_again() -> None:
    hand = Hand().to_ready()
    hand.inputs = replace(hand.inputs, user_torque_unm=1_500_000, velocity_mdeg_s=25_000)
    for _ in range(12):
        hand.beat(*hand.act(OPEN))
    hand.inputs = replace(hand.inputs, velocity_mdeg_s=0)
    while not hand.state.torque.fade_ticks:
        hand.beat(*hand.act(OPEN))
    hand.inputs = replace(hand.inputs, velocity_mdeg_s=25_000)
    seen = []
    for _ in range(5):
        hand.beat(*hand.act(OPEN))
        seen.append((hand.state.torque.contact_ticks, hand.state.torque.fade_ticks))
    assert any(contact == 0 and fade > 0 for contact, fade in seen)
    assert seen[-1][1] == 0
    assert hand.state.torque.guide_tick == 0
