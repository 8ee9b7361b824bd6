from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbridge.bus.model.error_frames import ErrorKind
from hilbridge.bus.model.events import BusError, Delivered, Enqueued, Event, StateChanged
from hilbridge.bus.model.faults import FOREVER_NS, Corruption, QueueStall, Where, WireCut, WireFaults
from hilbridge.bus.model.frames import WireFrame, arbitration_key
from hilbridge.bus.model.medium import Medium
from hilbridge.bus.model.nodes import QueueOrder
from tests.bus.model.frames import BIT_NS, SECOND_NS, bits, delivered, run_out


def test_a_frame_arrives_after_exactly_its_bits() -> None:
    medium = Medium()
    sender, receiver = medium.attach("sender"), medium.attach("receiver")
    frame = WireFrame(0x060, b"12345678")
    assert medium.send(sender, frame, 7, 1000) is Enqueued.QUEUED
    assert medium.advance(1000) == []
    assert medium.due_ns == 1000 + bits(frame) * BIT_NS
    assert medium.advance(1000 + bits(frame) * BIT_NS - 1) == []
    assert medium.advance(1000 + bits(frame) * BIT_NS) == [
        Delivered(1000 + bits(frame) * BIT_NS, frame, sender, 7, (receiver,))
    ]
    assert medium.queued(sender) == 0
    assert medium.due_ns == FOREVER_NS


def test_the_next_frame_waits_for_three_bits_of_intermission() -> None:
    medium = Medium()
    sender, _ = medium.attach("sender"), medium.attach("receiver")
    frame = WireFrame(0x060, b"12345678")
    for tag in range(2):
        medium.send(sender, frame, tag, 0)
    assert [event.at_ns for event in run_out(medium)] == [bits(frame) * BIT_NS, (2 * bits(frame) + 3) * BIT_NS]
    assert medium.busy_ns == 2 * (bits(frame) + 3) * BIT_NS


def test_fd_frames_switch_to_the_data_bit_rate() -> None:
    medium = Medium(500_000, 2_000_000)
    sender, _ = medium.attach("sender"), medium.attach("receiver")
    frame = WireFrame(0x555, b"\x55" * 64, is_fd=True, bit_rate_switch=True)
    medium.send(sender, frame, 0, 0)
    assert [event.at_ns for event in run_out(medium)] == [26 * 2000 + 550 * 500]


def test_the_lowest_identifier_of_those_waiting_goes_first() -> None:
    medium = Medium()
    high, low, late = medium.attach("high"), medium.attach("low"), medium.attach("late")
    first, second, third = WireFrame(0x7FF), WireFrame(0x001), WireFrame(0x000)
    medium.send(high, first, 1, 0)
    medium.send(low, second, 2, 0)
    medium.send(late, third, 3, 1)  # one nanosecond after the start of frame: too late for this one
    assert [event.frame.can_id for event in delivered(run_out(medium))] == [0x001, 0x000, 0x7FF]
    assert medium.node(high).arbitration_losses == 2


@given(
    st.lists(
        st.tuples(st.integers(0, 3), st.integers(0, 0x7FF), st.integers(0, 8), st.integers(0, 2_000_000)),
        min_size=1,
        max_size=40,
        unique_by=lambda entry: entry[1],
    )
)
@settings(max_examples=60)
def test_order_is_that_of_a_naive_reference(entries: list[tuple[int, int, int, int]]) -> None:
    """Whatever is sent when: the same order and times as a bus written down in ten lines."""
    medium = Medium()
    nodes = [medium.attach(f"n{index}", queue_limit=100, order=QueueOrder.PRIORITY) for index in range(4)]
    entries = sorted(entries, key=lambda entry: entry[3])
    events: list[Event] = []
    for tag, (node, can_id, length, at_ns) in enumerate(entries):
        if at_ns:  # not `at_ns` itself: looking there would start a frame between two that are sent at one time
            events += medium.advance(at_ns - 1)
        medium.send(nodes[node], WireFrame(can_id, bytes(length)), tag, at_ns)
    events += run_out(medium)
    pending = [(at_ns, WireFrame(can_id, bytes(length))) for _, can_id, length, at_ns in entries]
    free_ns, expected = 0, []
    while pending:
        start_ns = max(free_ns, min(at_ns for at_ns, _ in pending))
        winner = min((entry for entry in pending if entry[0] <= start_ns), key=lambda entry: entry[1].can_id)
        pending.remove(winner)
        end_ns = start_ns + bits(winner[1]) * BIT_NS
        expected.append((end_ns, winner[1].can_id))
        free_ns = end_ns + 3 * BIT_NS
    assert [(event.at_ns, event.frame.can_id) for event in delivered(events)] == expected


@given(st.integers(0, 1000))
@settings(max_examples=30)
def test_how_often_one_looks_changes_nothing(seed: int) -> None:
    """Advancing in one leap, from event to event, or at random times tells the same events."""

    def play(mode: int) -> list[Event]:
        dice = random.Random(seed)
        steps = random.Random(seed + 1)
        faults = WireFaults(seed, 0.001, 0.5, stalls=(QueueStall("n1", 300_000, 900_000),))
        medium = Medium(faults=faults)
        nodes = [medium.attach(f"n{index}", queue_limit=50) for index in range(3)]
        sends = sorted((dice.randrange(1, 3_000_000), dice.randrange(3), dice.randrange(0x7FF)) for _ in range(30))
        events: list[Event] = []
        now_ns = 0
        for tag, (at_ns, node, can_id) in enumerate(sends):
            while mode == 1 and now_ns < at_ns - 1:
                now_ns = min(at_ns - 1, now_ns + steps.randrange(1, 100_000))
                events += medium.advance(now_ns)
            while mode == 2 and medium.due_ns < at_ns:
                events += medium.advance(max(medium.due_ns, now_ns))
            now_ns = at_ns
            events += medium.advance(at_ns - 1)
            medium.send(nodes[node], WireFrame(can_id, bytes(8)), tag, at_ns)
        if mode == 3:
            limit_ns = 10 * SECOND_NS
            while now_ns < limit_ns:
                now_ns, more = medium.advance_to_event(limit_ns)
                events += more
            return events
        return events + run_out(medium)

    assert play(0) == play(1) == play(2) == play(3)


@given(st.integers(0, 1000), st.sampled_from(["sound", "disturbed", "cut", "stalled"]))
@settings(max_examples=60)
def test_before_the_due_time_nothing_happens(seed: int, kind: str) -> None:
    """Who looks only once something is due misses nothing and learns it at the same look as who always looks."""
    faults = {
        "sound": WireFaults(seed),
        "disturbed": WireFaults(seed, 0.01, 0.5, corruptions=(Corruption(0x100, Where.CRC, count=60),)),
        "cut": WireFaults(seed, cuts=(WireCut(frozenset({"n1"}), 500_000, 2_000_000),)),
        "stalled": WireFaults(seed, stalls=(QueueStall("n1", 300_000, 900_000),)),
    }[kind]

    def play(*, patient: bool) -> tuple[list[tuple[int, list[Event]]], int]:
        dice, medium = random.Random(seed), Medium(faults=faults)
        nodes = [medium.attach(f"n{index}") for index in range(3)]
        told, looks = [], 0
        for now_ns in range(0, 30_000_000, 50_000):
            if dice.random() < 0.05 and now_ns < 8_000_000:
                medium.send(nodes[dice.randrange(3)], WireFrame(dice.choice([0x100, 0x200]), bytes(8)), now_ns, now_ns)
            if patient and now_ns < medium.due_ns:
                continue
            looks += 1
            if events := medium.advance(now_ns):
                told.append((now_ns, events))
        return told, looks

    (patient, few), (always, many) = play(patient=True), play(patient=False)
    assert patient == always
    if kind == "sound":
        assert few < many


@pytest.mark.parametrize(
    ("order", "expected"),
    [(QueueOrder.FIFO, [0x100, 0x700, 0x010]), (QueueOrder.PRIORITY, [0x010, 0x100, 0x700])],
)
def test_a_first_in_first_out_queue_blocks_behind_its_head_and_a_priority_queue_does_not(
    order: QueueOrder, expected: list[int]
) -> None:
    medium = Medium()
    node, other = medium.attach("node", order=order), medium.attach("other")
    medium.send(node, WireFrame(0x700), 1, 0)
    medium.send(node, WireFrame(0x010), 2, 0)
    medium.send(other, WireFrame(0x100), 3, 0)
    assert [event.frame.can_id for event in delivered(run_out(medium))] == expected


def test_a_full_queue_refuses_like_a_real_interface() -> None:
    medium = Medium()
    sender, _ = medium.attach("sender"), medium.attach("receiver")
    results = [medium.send(sender, WireFrame(value), value, 0) for value in range(12)]
    assert results == [Enqueued.QUEUED] * 10 + [Enqueued.FULL] * 2
    medium.advance(bits(WireFrame(0)) * BIT_NS)
    assert medium.send(sender, WireFrame(1), 1, bits(WireFrame(0)) * BIT_NS) is Enqueued.QUEUED


def test_listen_only_nodes_hear_but_neither_send_nor_acknowledge() -> None:
    medium = Medium()
    sender, listener = medium.attach("sender"), medium.attach("listener", listen_only=True)
    assert medium.send(listener, WireFrame(1), 0, 0) is Enqueued.LISTEN_ONLY
    medium.send(sender, WireFrame(1), 0, 0)
    first = medium.advance(200_000)[0]
    assert isinstance(first, BusError)
    assert first.errors == {sender: ErrorKind.ACK, listener: ErrorKind.FORM}
    helper = medium.attach("helper")
    assert [event.receivers for event in delivered(medium.advance(400_000))] == [(listener, helper)]


def test_a_frame_that_cannot_be_is_refused() -> None:
    medium = Medium()
    assert medium.send(medium.attach("n"), WireFrame(0x800), 0, 0) is Enqueued.BAD_FRAME


def test_two_nodes_with_one_identifier_and_different_data_disturb_each_other() -> None:
    medium = Medium()
    one, other, _ = medium.attach("one"), medium.attach("other"), medium.attach("listener")
    medium.send(one, WireFrame(0x100, b"\x00" * 8), 1, 0)
    medium.send(other, WireFrame(0x100, b"\xff" * 8), 2, 0)
    events = run_out(medium)
    collisions = [event for event in events if isinstance(event, BusError)]
    assert len(collisions) >= 16
    assert collisions[0].errors[other] is ErrorKind.BIT
    # Once passive, the one that sends recessive bits can no longer disturb: the dominant frame passes, then the other.
    assert [event.tag for event in delivered(events) if event.sent] == [1, 2]


def test_two_nodes_with_one_identical_frame_do_not_notice() -> None:
    medium = Medium()
    one, other, listener = medium.attach("one"), medium.attach("other"), medium.attach("listener")
    medium.send(one, WireFrame(0x001), 1, 0)
    medium.send(other, WireFrame(0x001), 2, 0)
    events = run_out(medium)
    assert [(event.tag, event.receivers) for event in delivered(events)] == [(1, (listener,)), (2, ())]
    assert not any(isinstance(event, BusError | StateChanged) for event in events)


def test_wrong_rates_are_refused() -> None:
    with pytest.raises(ValueError, match="bit_error_rate"):
        WireFaults(bit_error_rate=2.0)
    with pytest.raises(ValueError, match="bit rate"):
        Medium(bitrate=0)


def test_base_frames_win_over_extended_ones_with_the_same_leading_bits() -> None:
    base, extended = WireFrame(0x123), WireFrame(0x123 << 18, is_extended=True)
    remote = WireFrame(0x123, is_remote=True)
    assert arbitration_key(base) < arbitration_key(remote) < arbitration_key(extended)


def test_a_clock_that_was_set_back_does_not_keep_frames_waiting() -> None:
    medium = Medium()
    sender, _ = medium.attach("sender"), medium.attach("receiver")
    for tag, ready_ns in enumerate((0, 50_000_000, 60_000_000)):
        medium.send(sender, WireFrame(0x100 + tag), tag, ready_ns)
    medium.advance(1_000)
    medium.hasten(2_000_000)
    events = delivered(medium.advance(3_000_000))
    assert [event.tag for event in events] == [0, 1, 2]
    assert 2_000_000 < events[1].at_ns < events[2].at_ns
    assert medium.queued(sender) == 0
