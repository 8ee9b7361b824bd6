"""What only shows at the edge of a rule or between two of them: each test here kills a mutant that the others let live."""

from __future__ import annotations

import math
from copy import copy

import pytest

from firmware_sim import e2e, frames
from firmware_sim.e2e import Check, Machine, Receiver
from firmware_sim.frames import Reject
from firmware_sim.law import filters
from firmware_sim.law.numbers import RAMP_TICKS, REMAINING
from firmware_sim.memory import COUNT_LOST, ECHO_AGE_MAX_MS, ControllerState, Inputs, Received
from firmware_sim.states import Reason, State
from tests.safety.hand import BOOT_NONCE, KEY, POUR, TAKE, Hand
from tests.safety.stepping import step

requirement = pytest.mark.requirement
CLEAR = frames.PURPOSE_CLEAR_LATCH
CUT = 4


def valid_and_armed() -> Hand:
    hand = Hand().to_follow()
    for _ in range(4):
        hand.beat(hand.hold())
    return hand.arm()


# The tick and the self-test


@requirement("W6")
def test_the_first_tick_of_all_may_come_at_any_time() -> None:
    state, _ = step(ControllerState(KEY, BOOT_NONCE), Inputs(), 1000)
    assert state.state == State.SELFTEST


def test_the_self_test_decides_in_its_own_state_only() -> None:
    hand = Hand().to_follow()
    hand.run(100, self_test_ok=False)
    assert hand.state.state == State.FOLLOW


@requirement("S10")
def test_one_implausible_tick_says_nothing_about_range_speed_or_torque() -> None:
    hand = Hand().to_follow()
    hand.tick(angle_mdeg=190_000, second_angle_mdeg=190_000, velocity_mdeg_s=900_000)
    assert hand.state.state == State.FOLLOW


# Sensing, echo, counters


@requirement("W4")
@pytest.mark.parametrize("age", [76, frames.AGE_UNKNOWN])
def test_h8_a_hold_that_tells_of_stale_sensing_is_a_fault(age: int) -> None:
    hand = Hand().to_assist()
    hand.tick(hand.hold(age=age))
    assert (hand.state.state, hand.state.reason) == (State.RAMP_DOWN, Reason.SENSING_STALE)
    assert hand.state.ramp_fault
    hand.until_zero()
    hand.tick()
    assert hand.state.state == State.FOLLOW
    ready = Hand().to_ready()
    ready.tick(ready.hold(age=age))
    assert (ready.state.state, ready.state.reason) == (State.FOLLOW, Reason.SENSING_STALE)


@requirement("W4", "S2")
def test_h8_a_hold_with_stale_sensing_is_not_neutral() -> None:
    hand = valid_and_armed()
    for _ in range(5):
        hand.beat(hand.hold(age=76))
        assert hand.state.neutral == 0
    hand.beat(hand.hold(age=75))
    assert hand.state.neutral == 1


@requirement("W3", "S2")
@pytest.mark.parametrize(("age_ms", "neutral"), [(100, 2), (101, 0)])
def test_h8_the_echo_of_a_neutral_hold_may_be_100_ms_old(age_ms: int, neutral: int) -> None:
    hand = valid_and_armed()
    while hand.state.status_due_ms != hand.now_ms + 20:
        hand.tick()
    echo, sent_ms = hand.status_counter, hand.now_ms
    while hand.now_ms < sent_ms + age_ms - 1:
        hand.tick(*((hand.hold(),) if hand.now_ms - sent_ms == 30 else ()))
    hand.tick(hand.hold(echo=echo))
    assert hand.now_ms - sent_ms == age_ms
    assert hand.state.neutral == neutral


@requirement("W3", "P9")
def test_h9_an_act_with_an_echo_nobody_remembers_is_refused_and_nothing_raises() -> None:
    hand = Hand().to_ready()
    hand.tick(hand.act_cmd(frames.GATE_ACT, TAKE, echo=(hand.status_counter - 100) & 0xFF))
    assert hand.count(Reject.ECHO) == 1
    assert hand.state.pending is None


def test_the_oldest_echo_taken_is_remembered_and_never_falls() -> None:
    hand = Hand().to_ready()
    seen = []
    for old in (1, 3, 1, 2):
        hand.tick(hand.heartbeat(), *hand.act(TAKE, echo=(hand.status_counter - old) & 0xFF))
        seen.append(hand.count(ECHO_AGE_MAX_MS))
        hand.run(39)
    assert 20 < seen[0] <= 40 < seen[1] <= 80
    assert seen[1:] == [seen[1]] * 3


def test_h9_lost_frames_are_counted_once() -> None:
    hand = Hand().to_ready()
    for skipped in (0, 1, 0, 2, 0, 0):
        hand.counters[frames.ACT_CMD] += skipped
        hand.beat(hand.hold())
    assert hand.count(COUNT_LOST) == 3


def test_a_hold_too_is_acknowledged_by_its_counter() -> None:
    hand = Hand().to_ready()
    command = hand.hold()
    hand.tick(command)
    assert hand.state.accepted_counter == command.data[2]


@requirement("P9")
def test_h9_stop_and_handshake_count_as_accepted() -> None:
    hand = Hand().to_follow()
    counts = []
    for frame in (lambda: hand.request(), lambda: hand.response(), lambda: Received(frames.STOP, b"")):
        before = hand.count(Reject.ACCEPTED)
        hand.tick(frame())
        counts.append(hand.count(Reject.ACCEPTED) - before)
    assert counts == [1, 1, 1]


# Faults upon faults


@requirement("S6", "W1", "W5")
def test_a_command_timeout_during_the_ramp_of_another_trip_is_no_second_trip() -> None:
    hand = Hand().to_assist(POUR)
    hand.tick(hand.heartbeat())
    beaten_ms = hand.now_ms
    while hand.now_ms < beaten_ms + 240:  # commands go on, heartbeats do not; the last command 90 ms before the end
        due = (hand.now_ms - beaten_ms) % 40 == 0 and hand.now_ms <= beaten_ms + 160
        hand.tick(*(hand.act(POUR) if due else ()))
    assert hand.state.state == State.ASSIST
    hand.run(10)
    assert (hand.state.state, hand.state.reason) == (State.RAMP_DOWN, Reason.HEARTBEAT_TIMEOUT)
    hand.run(30)
    assert not hand.state.command_live
    assert len(hand.state.trips) == 1


def test_the_reason_of_a_ramp_stays_that_of_its_fault() -> None:
    hand = Hand().to_assist()
    hand.tick(hand.heartbeat())
    beaten_ms = hand.now_ms
    while hand.now_ms < beaten_ms + 239:
        due = (hand.now_ms - beaten_ms) % 40 == 0
        hand.tick(*(hand.act() if due else ()))
    hand.tick(bus_off=True)
    hand.run(15, bus_off=True)  # the heartbeat would be overdue by now: but nobody is armed
    assert (hand.state.state, hand.state.reason) == (State.RAMP_DOWN, Reason.BUS_OFF)
    silent = Hand().to_assist()
    while silent.state.state == State.ASSIST:
        silent.tick(*((silent.heartbeat(),) if silent.now_ms % 50 == 0 else ()))
    silent.tick(Received(frames.ACT_CMD, b"\xff" * 8))  # the machine is invalid already
    assert (silent.state.state, silent.state.reason) == (State.RAMP_DOWN, Reason.COMMAND_TIMEOUT)


@requirement("W1", "P1")
def test_h2_after_a_command_timeout_the_machine_has_to_earn_trust_again() -> None:
    hand = Hand().to_assist()
    hand.run(150)
    slot = frames.RECEIVED_IDS.index(frames.ACT_CMD)
    assert hand.state.receivers[slot].machine == Machine.INVALID
    hand.tick(hand.hold())
    assert hand.state.receivers[slot].machine == Machine.INVALID


@requirement("S7")
def test_clearing_forgets_trips_and_bus_offs() -> None:
    hand = Hand().to_ready()
    hand.tick(Received(frames.CTRL_STATUS, b""))
    hand.run(600)
    hand.tick(hand.request(CLEAR))
    hand.tick(hand.response(CLEAR), hand.hold())
    hand.state.trips, hand.state.bus_offs = (hand.now_ms - 2, hand.now_ms - 1), (hand.now_ms - 1,)
    hand.tick(local_clear=True)
    assert hand.state.state == State.SELFTEST
    assert (hand.state.trips, hand.state.bus_offs) == ((), ())


@requirement("P6", "S2")
def test_h1_arming_anew_begins_neutral_anew() -> None:
    hand = valid_and_armed()
    hand.beat(hand.hold()).beat(hand.hold())
    assert hand.state.neutral == 2
    hand.arm()
    assert hand.state.neutral == 0
    hand.beat(hand.hold())
    assert hand.state.state == State.FOLLOW


# Torque that other states own


@requirement("T4", "S10")
def test_h3_sensors_lost_during_a_latch_do_not_quicken_the_ramp() -> None:
    hand = Hand().to_assist()
    before = hand.outputs.assist_unm
    for tick in range(1, RAMP_TICKS + 1):
        received = (Received(frames.CTRL_STATUS, b""),) if tick == 1 else ()
        hand.tick(*received, second_angle_mdeg=30_000 if tick < 3 else 90_000)
        assert hand.state.state == State.LATCHED
        assert abs(hand.outputs.assist_unm) > abs(before) * (REMAINING[tick] - 1) // 1000 - 2
        assert abs(hand.outputs.assist_unm) <= abs(before) * REMAINING[tick] // 1000


def test_h6_the_filters_run_in_every_state() -> None:
    hand = Hand().to_follow().run(1000)
    assert hand.state.torque.slow_mean == pytest.approx(20_000 * 1024, rel=0.02)


# AUTOSAR's numbers


def test_check_and_machine_have_the_numbers_of_autosar() -> None:
    assert [(check.name, check.value) for check in Check] == [
        ("OK", 0),
        ("ERROR", 1),
        ("REPEATED", 2),
        ("NO_NEW_DATA", 3),
        ("OK_SOME_LOST", 4),
        ("WRONG_SEQUENCE", 5),
    ]
    assert [(machine.name, machine.value) for machine in Machine] == [
        ("NO_DATA", 0),
        ("INIT", 1),
        ("VALID", 2),
        ("INVALID", 3),
    ]


@requirement("P1")
@pytest.mark.parametrize(
    ("can_id", "most"),
    [(can_id, 3) for can_id in (frames.ACT_CMD, frames.BRIDGE_HB)]
    + [(can_id, 255) for can_id in (frames.ACT_AUTH, frames.ARM_REQUEST, frames.ARM_RESPONSE, frames.BRIDGE_DIAG)],
)
def test_cyclic_messages_may_lose_two_frames_and_events_any_number(can_id: int, most: int) -> None:
    for delta in (2, 3, 4, 254, 255):
        data = e2e.protect(can_id, bytes(8), 10 + delta)
        found, _ = e2e.check(can_id, data, Receiver(10, Machine.VALID, (Check.OK,) * 4))
        assert found == (Check.OK_SOME_LOST if delta <= most else Check.WRONG_SEQUENCE)


@pytest.mark.parametrize("again", ["hold", "act"])
def test_a_command_during_a_ramp_is_no_fault(again: str) -> None:
    hand = Hand().to_assist()
    hand.tick(hand.hold())
    assert hand.state.state == State.RAMP_DOWN
    hand.run(10)
    hand.tick(*((hand.hold(),) if again == "hold" else hand.act()))
    assert (hand.state.state, hand.state.reason, hand.state.ramp_fault) == (State.RAMP_DOWN, Reason.HOLD, False)
    hand.until_zero()
    assert hand.state.state == State.READY


# Torque


@pytest.mark.parametrize("verb", [TAKE, POUR])
def test_h5_the_filters_go_on_while_assisting(verb: int) -> None:
    hand = Hand().to_assist(verb)
    law = copy(hand.state.torque)
    hand.tick(velocity_mdeg_s=-5_000, user_torque_unm=900_000)
    assert hand.state.state == State.ASSIST
    filters.track(law, -5_000, 900_000)
    for name in ("slow_mean", "second_mean", "fast_mdeg_s", "user_mean", "impulse", "wave_ticks", "slot_tick"):
        assert getattr(hand.state.torque, name) == getattr(law, name), name


@requirement("T6", "T8")
@pytest.mark.parametrize("verb", [CUT, 8])
def test_h1_a_hold_in_mid_movement_leaves_nothing_for_a_still_arm(verb: int) -> None:
    hand = Hand().to_ready()
    for period in range(20):  # a movement that shakes
        for tick in range(40):
            velocity = round(30_000 * math.sin(2 * math.pi * 6 * (period * 40 + tick) / 1000))
            frames_now = (hand.heartbeat(), *hand.act(verb)) if tick == 0 else ()
            hand.tick(*frames_now, velocity_mdeg_s=velocity)
    assert hand.state.state == State.ASSIST
    for _ in range(25):
        hand.tick(hand.heartbeat(), hand.hold(), velocity_mdeg_s=0)
        hand.run(39, velocity_mdeg_s=0)
    for _ in range(20):
        hand.tick(hand.heartbeat(), *hand.act(verb), velocity_mdeg_s=0)
        for _ in range(39):
            hand.tick(velocity_mdeg_s=0)
            assert hand.outputs.assist_unm == 0
    assert hand.state.state == State.ASSIST
