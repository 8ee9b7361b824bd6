"""What the device takes for a command: each condition of ACT broken alone, and what feeds a deadline."""

from __future__ import annotations

import pytest

from firmware_sim import e2e, frames, secoc
from firmware_sim.frames import Reject
from firmware_sim.memory import ECHO_AGE_MAX_MS, Received
from firmware_sim.states import Reason, State
from tests.safety.hand import MOVE_AROUND, POUR, PUT, TAKE, Hand

requirement = pytest.mark.requirement


@requirement("S2")
@pytest.mark.parametrize("holds", [0, 1, 2])
def test_h1_fewer_than_three_holds_never_make_ready(holds: int) -> None:
    hand = Hand().to_follow()
    for _ in range(4):
        hand.beat(hand.hold())  # E2E becomes VALID, but nobody is armed
    hand.arm()
    for _ in range(holds):
        hand.beat(hand.hold())
    assert hand.state.state == State.FOLLOW
    assert hand.state.neutral == holds
    command = hand.act()
    hand.beat(*command)
    assert hand.state.state == State.FOLLOW
    assert hand.state.neutral == 0
    assert hand.outputs.assist_unm == 0


@requirement("S2")
def test_third_hold_makes_ready_in_its_own_tick() -> None:
    hand = Hand().to_follow()
    for _ in range(4):
        hand.beat(hand.hold())
    hand.arm().beat(hand.hold()).beat(hand.hold())
    hand.tick(hand.hold())
    assert hand.state.state == State.READY
    assert hand.state.reason == Reason.NEUTRAL


@requirement("S2", "P5")
@pytest.mark.parametrize("broken", ["session", "echo", "unarmed", "e2e"])
def test_h1_a_hold_that_proves_nothing_is_not_neutral(broken: str) -> None:
    hand = Hand().to_follow()
    if broken != "e2e":
        for _ in range(4):
            hand.beat(hand.hold())
    if broken != "unarmed":
        hand.arm()
    for _ in range(2 if broken == "e2e" else 6):
        if broken == "session":
            hand.beat(hand.hold(session=hand.session + 1))
        elif broken == "echo":
            hand.beat(hand.hold(echo=(hand.status_counter - 20) & 0xFF))
        else:
            hand.beat(hand.hold())
    assert hand.state.state == State.FOLLOW
    assert hand.state.neutral == (1 if broken == "e2e" else 0)  # the second frame is the one that makes E2E VALID
    assert hand.state.command_live  # a HOLD is accepted from anybody


@requirement("S3")
def test_one_authorised_act_starts_assisting() -> None:
    hand = Hand().to_ready()
    command, authorisation = hand.act(TAKE)
    hand.tick(command)
    assert hand.state.state == State.READY
    hand.tick(authorisation)
    assert hand.state.state == State.ASSIST
    assert hand.state.reason == Reason.AUTHORISED
    assert hand.state.verb == TAKE
    assert hand.state.accepted_counter == command.data[2]
    assert hand.state.command_ms == hand.now_ms - 1  # the command's arrival, not the authorisation's
    assert not hand.state.command_is_hold


_BROKEN = {
    Reject.SESSION: ({"session": 99}, Reason.NOT_ARMED),
    Reject.AGE: ({"age": 76}, Reason.SENSING_STALE),
    Reject.VERB: ({"verb": MOVE_AROUND}, Reason.VERB_UNASSISTED),
}


@requirement("P5", "P8", "W4")
@pytest.mark.parametrize("why", list(_BROKEN))
def test_h1_h8_an_act_with_one_condition_broken_counts_as_hold_and_feeds_nothing(why: Reject) -> None:
    fields, reason = _BROKEN[why]
    hand = Hand().to_assist()
    fed_ms, before = hand.state.command_ms, hand.count(why)
    verb = fields.get("verb", TAKE)
    command = hand.act_cmd(frames.GATE_ACT, verb, **{k: v for k, v in fields.items() if k != "verb"})
    hand.tick(command, hand.auth(command))
    assert hand.state.state == State.RAMP_DOWN
    assert hand.state.reason == reason
    assert not hand.state.ramp_fault
    assert hand.state.command_ms == fed_ms
    assert hand.count(why) == before + 1
    assert hand.count(Reject.AUTH_UNPAIRED) == 1
    assert hand.until_zero() <= 40
    hand.tick()
    assert hand.state.state == State.READY


@requirement("W4")
@pytest.mark.parametrize(("age", "taken"), [(0, True), (74, True), (75, True), (76, False), (254, False), (255, False)])
def test_h8_sensing_up_to_150_ms_is_young_enough(age: int, taken: bool) -> None:
    hand = Hand().to_ready()
    hand.tick(*hand.act(age=age))
    assert (hand.state.state == State.ASSIST) == taken


@requirement("W3", "P7")
@pytest.mark.parametrize(("extra_ms", "taken"), [(0, True), (1, False)])
def test_h8_an_echo_up_to_100_ms_old_is_fresh(extra_ms: int, taken: bool) -> None:
    hand = Hand().to_ready()
    while hand.state.status_due_ms != hand.now_ms + 20:
        hand.tick()
    echo = hand.status_counter
    sent_ms = hand.now_ms
    while hand.now_ms < sent_ms + 99 + extra_ms:
        if (hand.now_ms - sent_ms) % 40 == 5:
            hand.tick(hand.hold(), hand.heartbeat())
        else:
            hand.tick()
    hand.tick(*hand.act(echo=echo))
    assert hand.now_ms - sent_ms == 100 + extra_ms
    assert (hand.state.state == State.ASSIST) == taken
    assert hand.count(Reject.ECHO) == (0 if taken else 1)
    if taken:
        assert hand.count(ECHO_AGE_MAX_MS) == 100
    else:
        assert hand.state.state == State.READY


@requirement("W3")
def test_the_youngest_status_with_the_counter_counts() -> None:
    hand = Hand().to_ready()
    echoes = ((9, hand.now_ms - 90), (7, hand.now_ms - 500), (7, hand.now_ms - 5))
    hand.state.echoes = echoes
    hand.tick(*hand.act(echo=7))
    assert hand.state.state == State.ASSIST
    assert hand.count(ECHO_AGE_MAX_MS) == 6


@requirement("P5")
def test_h1_act_from_an_unarmed_bridge_counts_as_hold() -> None:
    hand = Hand().to_follow()
    for _ in range(4):
        hand.beat(hand.hold())
    hand.tick(hand.act_cmd(frames.GATE_ACT, TAKE))
    assert hand.count(Reject.NOT_ARMED) == 1
    assert hand.state.pending is None


@requirement("P5")
def test_h1_act_before_e2e_is_valid_counts_as_hold() -> None:
    hand = Hand().to_follow().arm()
    hand.tick(hand.act_cmd(frames.GATE_ACT, TAKE))
    assert hand.count(Reject.E2E_STATE) == 1
    assert hand.state.pending is None


@requirement("W2")
@pytest.mark.parametrize(("gap_ms", "taken"), [(0, True), (9, True), (10, True), (11, False), (12, False)])
def test_h1_authorisation_has_ten_milliseconds(gap_ms: int, taken: bool) -> None:
    hand = Hand().to_ready()
    fed_ms = hand.state.command_ms
    command, authorisation = hand.act()
    if gap_ms == 0:
        hand.tick(command, authorisation)
    else:
        hand.tick(command)
        hand.run(gap_ms - 1)
        hand.tick(authorisation)
    assert (hand.state.state == State.ASSIST) == taken
    if not taken:
        assert hand.count(Reject.AUTH_MISSING) == 1
        assert hand.state.command_ms == fed_ms
        assert hand.state.pending is None


@requirement("W2")
def test_h1_an_act_never_authorised_ramps_down_after_ten_milliseconds() -> None:
    hand = Hand().to_assist()
    command, _lost = hand.act()
    hand.tick(command)
    hand.run(10)
    assert hand.state.state == State.ASSIST
    hand.tick()
    assert hand.state.state == State.RAMP_DOWN
    assert hand.state.reason == Reason.AUTH_MISSING
    assert hand.count(Reject.AUTH_MISSING) == 1
    hand.until_zero()
    hand.tick()
    assert hand.state.state == State.READY


@requirement("W2")
def test_a_second_command_overtakes_one_that_waits() -> None:
    hand = Hand().to_assist()
    first, _ = hand.act()
    second, _ = hand.act()
    hand.tick(first, second)
    assert hand.count(Reject.AUTH_MISSING) == 1
    assert hand.state.state == State.RAMP_DOWN
    assert hand.state.pending is not None
    assert hand.state.pending.counter == second.data[2]


@requirement("P6")
@pytest.mark.parametrize("broken", ["key", "freshness", "command"])
def test_h1_a_wrong_mac_counts_as_hold_and_is_remembered(broken: str) -> None:
    hand = Hand().to_assist()
    fed_ms = hand.state.command_ms
    command = hand.act_cmd(frames.GATE_ACT, TAKE)
    if broken == "key":
        authorisation = hand.auth(command, key=b"x" * 16)
    elif broken == "freshness":
        authorisation = hand.auth(command, freshness=hand.freshness)  # the one used last
    else:
        other = hand.act_cmd(frames.GATE_ACT, PUT, counter=command.data[2])
        authorisation = hand.auth(other)
    hand.tick(command, authorisation)
    assert hand.state.state == State.RAMP_DOWN
    assert hand.state.reason == Reason.AUTH_MISSING
    assert hand.state.command_ms == fed_ms
    assert hand.state.mac_failures == 1
    assert hand.count(Reject.MAC) == 1
    assert hand.count(22) == 1
    assert hand.state.pending is None
    assert hand.state.freshness == hand.freshness - (1 if broken != "freshness" else 0)


@requirement("P6", "S6")
def test_h1_three_mac_failures_latch_and_two_do_not() -> None:
    hand = Hand().to_ready()
    for failures in (1, 2, 3):
        command = hand.act_cmd(frames.GATE_ACT, TAKE)
        hand.beat(command, hand.auth(command, key=b"x" * 16), milliseconds=10)
        assert hand.state.mac_failures == failures
        assert (hand.state.state == State.LATCHED) == (failures == 3)
    assert hand.state.reason == Reason.MAC_FAILURES
    assert not hand.state.armed
    assert hand.state.key == b""


@requirement("P6")
def test_freshness_skips_over_lost_acts_but_never_goes_back() -> None:
    hand = Hand().to_ready()
    hand.freshness = 200
    hand.beat(*hand.act())
    assert hand.state.freshness == 201
    hand.freshness = 201 + 254
    hand.beat(*hand.act())
    assert hand.state.freshness == 456
    assert hand.state.state == State.ASSIST


@requirement("P6")
def test_freshness_ends_before_it_wraps() -> None:
    hand = Hand().to_ready()
    hand.state.freshness = secoc.FRESHNESS_LIMIT - 1
    hand.freshness = secoc.FRESHNESS_LIMIT - 1
    hand.beat(*hand.act())
    assert hand.state.state == State.ASSIST
    assert hand.state.freshness == secoc.FRESHNESS_LIMIT
    command = hand.act_cmd(frames.GATE_ACT, TAKE)
    hand.tick(command, hand.frame(frames.ACT_AUTH, (0, 0)))
    assert hand.count(Reject.MAC) == 1
    assert hand.state.state == State.RAMP_DOWN


@requirement("P8")
def test_h2_authorisation_without_a_command_is_nothing() -> None:
    hand = Hand().to_ready()
    command = hand.act_cmd(frames.GATE_ACT, TAKE)
    hand.tick(hand.auth(command))
    assert hand.count(Reject.AUTH_UNPAIRED) == 1
    assert hand.state.state == State.READY
    assert hand.state.mac_failures == 0


@requirement("S4")
def test_h7_a_change_of_verb_goes_through_ramp_down_and_ready() -> None:
    hand = Hand().to_assist(TAKE)
    hand.tick(*hand.act(POUR))
    assert hand.state.state == State.RAMP_DOWN
    assert hand.state.reason == Reason.VERB_CHANGE
    assert hand.state.verb == TAKE
    assert not hand.state.ramp_fault
    hand.run(39)
    assert hand.state.state == State.READY
    hand.tick(*hand.act(POUR))
    assert hand.state.state == State.ASSIST
    assert hand.state.verb == POUR


@requirement("P8")
def test_an_act_in_ramp_down_feeds_the_watchdog_but_does_not_resume() -> None:
    hand = Hand().to_assist()
    hand.tick(hand.hold())
    hand.tick(*hand.act(TAKE))
    assert hand.state.state == State.RAMP_DOWN
    assert hand.state.command_ms == hand.now_ms


@requirement("P8", "P9", "P2")
def test_h2_a_frame_with_a_bad_crc_feeds_nothing_and_is_counted() -> None:
    hand = Hand().to_assist()
    fed_ms, beat_ms = hand.state.command_ms, hand.state.heartbeat_ms
    for frame in (hand.hold(), hand.heartbeat()):
        data = bytearray(frame.data)
        data[7] ^= 1
        hand.tick(Received(frame.can_id, bytes(data)))
    assert hand.count(Reject.CRC) == 2
    assert (hand.state.command_ms, hand.state.heartbeat_ms) == (fed_ms, beat_ms)
    assert hand.state.state == State.ASSIST


@requirement("P8", "P9")
def test_h2_a_repeated_or_jumping_counter_feeds_nothing() -> None:
    hand = Hand().to_assist()
    hold = hand.hold()
    hand.tick(hold)
    fed_ms = hand.state.command_ms
    hand.tick(hold)
    assert hand.count(Reject.REPEATED) == 1
    hand.tick(hand.hold(counter=(hold.data[2] + 4) & 0xFF))
    assert hand.count(Reject.SEQUENCE) == 1
    assert hand.state.command_ms == fed_ms


@requirement("P14", "P9")
def test_two_lost_commands_are_some_lost_and_counted() -> None:
    hand = Hand().to_ready()
    hold = hand.hold(counter=(hand.counters[frames.ACT_CMD] + 3) & 0xFF)
    hand.tick(hold)
    assert hand.state.command_ms == hand.now_ms
    assert hand.count(27) == 2


@requirement("S8")
def test_h9_one_bad_frame_recovers_alone_two_in_the_window_are_a_fault() -> None:
    hand = Hand().to_assist()
    bad = Received(frames.ACT_CMD, bytes(8))
    hand.tick(bad)
    assert hand.state.state == State.ASSIST
    hand.tick(bad)
    assert hand.state.state == State.RAMP_DOWN
    assert hand.state.reason == Reason.E2E_INVALID
    assert hand.state.neutral == 0
    assert len(hand.state.trips) == 1
    hand.until_zero()
    hand.tick()
    assert hand.state.state == State.FOLLOW


@requirement("S8")
def test_bad_frames_of_another_message_do_not_end_an_assist() -> None:
    hand = Hand().to_assist()
    for _ in range(5):
        hand.tick(Received(frames.BRIDGE_HB, bytes(8)))
    assert hand.state.state == State.ASSIST
    slot = frames.RECEIVED_IDS.index(frames.BRIDGE_HB)
    assert hand.state.receivers[slot].machine == e2e.Machine.INVALID


@requirement("P9")
@pytest.mark.parametrize(
    ("frame", "why"),
    [
        (Received(frames.ACT_CMD, b""), Reject.LENGTH),
        (Received(frames.ACT_CMD, bytes(7)), Reject.LENGTH),
        (Received(frames.BRIDGE_HB, bytes(9)), Reject.LENGTH),
        (Received(0x7FF, bytes(8)), Reject.UNKNOWN_ID),
        (Received(frames.ACT_CMD, bytes(8), plain=False), Reject.KIND),
    ],
)
def test_h9_what_is_no_frame_of_ours_is_counted_under_its_reason(frame: Received, why: Reject) -> None:
    hand = Hand().to_ready()
    hand.tick(frame)
    assert hand.count(why) == 1
    assert hand.state.state == State.READY


@requirement("P9", "P4")
@pytest.mark.parametrize(
    ("can_id", "bit", "width", "value", "why"),
    [
        (frames.ACT_CMD, 24, 2, 0, Reject.ENUM),
        (frames.ACT_CMD, 24, 2, 3, Reject.ENUM),
        (frames.ACT_CMD, 26, 5, 22, Reject.ENUM),
        (frames.ACT_CMD, 31, 7, 101, Reject.RANGE),
        (frames.ACT_CMD, 62, 2, 1, Reject.RESERVED),
        (frames.BRIDGE_HB, 24, 4, 8, Reject.RANGE),
        (frames.BRIDGE_HB, 28, 4, 5, Reject.ENUM),
        (frames.BRIDGE_HB, 56, 8, 0, Reject.RANGE),
        (frames.BRIDGE_DIAG, 24, 8, 22, Reject.MUX),
        (frames.ARM_REQUEST, 56, 8, 3, Reject.ENUM),
    ],
)
def test_content_outside_the_contract_is_rejected_even_with_a_good_crc(
    can_id: int, bit: int, width: int, value: int, why: Reject
) -> None:
    hand = Hand().to_ready()
    good = {
        frames.ACT_CMD: (1, 0, 0, 0, 0, 0),
        frames.BRIDGE_HB: (7, 1, 0, 7, 1),
        frames.BRIDGE_DIAG: (0, 0),
        frames.ARM_REQUEST: (0, 1),
    }[can_id]
    word = int.from_bytes(frames.pack(can_id, good), "little")
    word = word & ~(((1 << width) - 1) << bit) | value << bit
    counter = (hand.counters.get(can_id, 0) + 1) & 0xFF
    fed = (hand.state.command_ms, hand.state.heartbeat_ms)
    hand.tick(Received(can_id, e2e.protect(can_id, word.to_bytes(8, "little"), counter)))
    assert hand.count(why) == 1
    assert (hand.state.command_ms, hand.state.heartbeat_ms) == fed


@requirement("W5")
def test_a_heartbeat_of_another_protocol_version_does_not_count() -> None:
    hand = Hand().to_ready()
    beat_ms = hand.state.heartbeat_ms
    hand.tick(hand.heartbeat(version=2))
    assert hand.count(Reject.RANGE) == 1
    assert hand.state.heartbeat_ms == beat_ms
    hand.tick(hand.heartbeat())
    assert hand.state.heartbeat_ms == hand.now_ms


@requirement("P9")
def test_bridge_diag_is_accepted_and_changes_nothing() -> None:
    hand = Hand().to_ready()
    before = hand.count(Reject.ACCEPTED)
    hand.tick(hand.frame(frames.BRIDGE_DIAG, (3, 77)))
    assert hand.count(Reject.ACCEPTED) == before + 1
    assert hand.state.state == State.READY


@requirement("P9")
def test_counters_stop_at_32_bits() -> None:
    hand = Hand().to_ready()
    counters = list(hand.state.counters)
    counters[int(Reject.UNKNOWN_ID)] = 0xFFFFFFFF
    hand.state.counters = tuple(counters)
    hand.tick(Received(0x7FF, b""))
    assert hand.count(Reject.UNKNOWN_ID) == 0xFFFFFFFF


@requirement("P8")
def test_h2_every_accepted_kind_is_counted_once() -> None:
    hand = Hand().to_ready()
    before = hand.count(Reject.ACCEPTED)
    hand.tick(hand.hold(), hand.heartbeat(), *hand.act())
    # ACT_CMD itself counts when its authorisation does.
    assert hand.count(Reject.ACCEPTED) == before + 3
