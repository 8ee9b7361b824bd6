"""What the device takes in and what it refuses: each frame adds to exactly one counter."""

from __future__ import annotations

import pytest

from firmware_sim import e2e, frames
from firmware_sim.frames import Reject
from firmware_sim.memory import Received
from firmware_sim.states import Reason, State
from tests.safety.hand import MOVE_AROUND, Hand

requirement = pytest.mark.requirement
_BROKEN = {
    Reject.SESSION: ({"session": 99}, Reason.NOT_ARMED),
    Reject.AGE: ({"age": 76}, Reason.SENSING_STALE),
    Reject.VERB: ({"verb": MOVE_AROUND}, Reason.VERB_UNASSISTED),
}


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
        (frames.BRIDGE_DIAG, 24, 8, 24, Reject.MUX),
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
