from __future__ import annotations

import pytest

from hilbridge.bus.model.error_frames import ErrorKind, ErrorState
from hilbridge.bus.model.events import BusError, Delivered, FrameLost
from hilbridge.bus.model.faults import Babble, Corruption, QueueStall, Where, WireCut, WireFaults
from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.model.medium import Medium
from tests.bus.model.frames import BIT_NS, SECOND_NS, bits, delivered, run_out


def test_a_babbling_node_starves_everybody_less_urgent_and_nobody_more_urgent() -> None:
    babble = Babble("mad", 0x010, b"\x55" * 8, 0, 10_000_000)
    medium = Medium(faults=WireFaults(babbles=(babble,)))
    medium.attach("mad")
    low, high = medium.attach("low"), medium.attach("high")
    medium.send(low, WireFrame(0x060), 1, 0)
    medium.send(high, WireFrame(0x001), 2, 5_000_000)
    events = delivered(run_out(medium))
    frame_ns = (bits(WireFrame(0x010, b"\x55" * 8)) + 3) * BIT_NS
    urgent = next(event for event in events if event.frame.can_id == 0x001)
    starved = next(event for event in events if event.frame.can_id == 0x060)
    assert urgent.at_ns <= 5_000_000 + frame_ns + bits(WireFrame(1)) * BIT_NS
    assert starved.at_ns >= 10_000_000
    assert medium.fault_state.effects["babble"] == 10_000_000 // frame_ns + 1


def test_a_stalled_queue_sends_late_and_in_order() -> None:
    medium = Medium(faults=WireFaults(stalls=(QueueStall("slow", 0, 3_000_000),)))
    slow, other = medium.attach("slow"), medium.attach("other")
    for tag in range(3):
        medium.send(slow, WireFrame(0x100 + tag), tag, tag * 1000)
    medium.send(other, WireFrame(0x7FF), 9, 0)
    events = delivered(run_out(medium))
    assert [event.tag for event in events] == [9, 0, 1, 2]
    assert events[1].at_ns == 3_000_000 + bits(WireFrame(0x100)) * BIT_NS
    assert medium.fault_state.effects["stall"] > 0


def test_a_cut_node_hears_nothing_and_is_not_acknowledged_until_the_wire_is_whole_again() -> None:
    medium = Medium(faults=WireFaults(cuts=(WireCut(frozenset({"lost"}), 1_000_000, 5_000_000),)))
    lost, one, other = medium.attach("lost"), medium.attach("one"), medium.attach("other")
    medium.send(one, WireFrame(0x100), 0, 0)
    medium.send(one, WireFrame(0x101), 1, 2_000_000)
    medium.send(lost, WireFrame(0x200), 2, 2_000_000)
    medium.send(one, WireFrame(0x102), 3, 6_000_000)
    events = run_out(medium)
    heard = {event.frame.can_id: event.receivers for event in delivered(events)}
    assert heard[0x100] == (lost, other)
    assert heard[0x101] == (other,)
    assert heard[0x102] == (lost, other)
    assert set(heard[0x200]) == {one, other}
    sent = next(event for event in delivered(events) if event.frame.can_id == 0x200)
    assert sent.at_ns > 5_000_000
    lonely = [event for event in events if isinstance(event, BusError)]
    assert {kind for event in lonely for kind in event.errors.values()} == {ErrorKind.ACK}
    assert medium.node(lost).state is ErrorState.WARNING  # passive by 16 missing ACKs, one success ended that
    assert medium.fault_state.effects["cut"] == 1


def test_a_node_that_never_acknowledges_leaves_a_lone_sender_error_passive_but_never_bus_off() -> None:
    medium = Medium(faults=WireFaults(no_ack=frozenset({"mute"})))
    sender, mute = medium.attach("sender"), medium.attach("mute")
    medium.send(sender, WireFrame(0x100), 0, 0)
    events = medium.advance(SECOND_NS)
    assert medium.node(sender).confinement.tec == 128
    assert medium.node(sender).state is ErrorState.PASSIVE
    assert not any(isinstance(event, FrameLost) for event in events)
    assert mute in delivered(events)[0].receivers  # a passive sender's error flag does not spoil what others hear
    assert not delivered(events)[0].sent


@pytest.mark.parametrize("bit", list(Where))
def test_a_corruption_costs_one_attempt_and_the_frame_comes_again(bit: Where) -> None:
    medium = Medium(faults=WireFaults(corruptions=(Corruption(0x100, bit),)))
    sender, receiver = medium.attach("sender"), medium.attach("receiver")
    medium.send(sender, WireFrame(0x100, b"\x12\x34"), 5, 0)
    events = run_out(medium)
    good = [event for event in delivered(events) if event.sent]
    assert [event.tag for event in good] == [5]
    assert medium.fault_state.effects["corruption"] == 1
    assert medium.node(sender).failures == 1
    twice = [event for event in delivered(events) if not event.sent]
    # At the last bit of end of frame receivers have accepted already: the well-known double reception.
    assert len(twice) == (1 if bit is Where.LAST_EOF else 0)
    assert good[0].receivers == (receiver,)


def test_an_error_seen_by_one_receiver_spoils_the_frame_for_all() -> None:
    medium = Medium(faults=WireFaults(corruptions=(Corruption(0x100, Where.CRC, receiver="noisy"),)))
    sender, noisy, quiet = medium.attach("sender"), medium.attach("noisy"), medium.attach("quiet")
    medium.send(sender, WireFrame(0x100, b"\x12\x34"), 5, 0)
    events = run_out(medium)
    failed = next(event for event in events if isinstance(event, BusError))
    assert set(failed.errors) == {sender, noisy, quiet}
    assert [event.receivers for event in delivered(events)] == [(noisy, quiet)]
    # Rules a and b: 1 + 8 for the one whose flag came first, 1 for the other; then one good frame each.
    assert (medium.node(noisy).confinement.rec, medium.node(quiet).confinement.rec) == (8, 0)
    assert medium.node(sender).confinement.tec == 7


def test_a_bit_error_rate_hits_as_often_as_it_says() -> None:
    medium = Medium(faults=WireFaults(seed=5, bit_error_rate=1e-3))
    sender, _ = medium.attach("sender", queue_limit=10_000), medium.attach("receiver")
    frame = WireFrame(0x100, b"\x5a" * 8)
    total = 3000
    for tag in range(total):
        medium.send(sender, frame, tag, 0)
        medium.advance(tag)
    events = run_out(medium, 10 * SECOND_NS)
    assert len([event for event in delivered(events) if event.sent]) == total
    attempts = total + medium.node(sender).failures
    expected = attempts * (1 - (1 - 1e-3) ** bits(frame))
    assert 0.85 * expected < medium.node(sender).failures < 1.15 * expected


def test_a_babble_begins_when_it_is_asked_for_not_when_the_bus_fell_silent() -> None:
    medium = Medium()
    medium.attach("mad")
    medium.attach("other")
    medium.advance(3600 * SECOND_NS)
    medium.use_faults(WireFaults(babbles=(Babble("mad", 0x100),)))
    _, events = medium.advance_to_event(None)
    assert [event.at_ns > 3600 * SECOND_NS for event in events] == [True]


def test_a_babbling_node_that_was_cut_off_or_bus_off_begins_anew_when_it_is_back() -> None:
    cut = WireCut(frozenset({"mad"}), 1_000_000, 500_000_000)
    for faults, back_ns in (
        (WireFaults(babbles=(Babble("mad", 0x100, from_ns=2_000_000),), cuts=(cut,)), 500_000_000),
        (WireFaults(babbles=(Babble("mad", 0x100),), corruptions=(Corruption(0x100, count=32),)), 0),
    ):
        medium = Medium(faults=faults)
        mad, _ = medium.attach("mad"), medium.attach("other")
        reached_ns, arrived = 0, list[Delivered]()
        while not arrived:
            reached_ns, events = medium.advance_to_event(None)
            assert events  # else nothing would ever come
            if medium.node(mad).state is ErrorState.BUS_OFF and not back_ns:
                back_ns = reached_ns + 128 * 11 * BIT_NS
            arrived = delivered(events)
        assert arrived[0].at_ns == reached_ns > back_ns


def test_stubs_of_nodes_that_have_gone_are_forgotten() -> None:
    medium = Medium(faults=WireFaults(cuts=(WireCut(frozenset({"lost"})),)))
    for _ in range(5):
        number = medium.attach("lost")
        medium.send(number, WireFrame(0x100), 1, 0)
        medium.advance(10_000)
        medium.detach(number)
        medium.advance(20_000)
    assert len(medium._wires) == 1


def test_a_frame_that_waits_through_a_cut_is_sent_when_the_wire_is_whole_with_nobody_else_to_wake_the_bus() -> None:
    medium = Medium(faults=WireFaults(cuts=(WireCut(frozenset({"lost"}), 1_000_000, 5_000_000),)))
    lost, other = medium.attach("lost"), medium.attach("other")
    medium.send(lost, WireFrame(0x200), 2, 2_000_000)
    arrived = list[Delivered]()
    while not arrived:
        at_ns, events = medium.advance_to_event(None)
        assert events
        arrived = delivered(events)
    assert arrived[0].receivers == (other,)
    assert 5_000_000 < at_ns < 6_000_000
