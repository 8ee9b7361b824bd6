"""Error confinement at exactly the counts of ISO 11898-1, through the medium and alone."""

from __future__ import annotations

from hilbridge.bus.model.confinement import Confinement
from hilbridge.bus.model.error_frames import ErrorState
from hilbridge.bus.model.events import Delivered, Enqueued, Event, FrameLost, StateChanged
from hilbridge.bus.model.faults import Corruption, Where, WireFaults
from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.model.medium import Medium

BIT_NS = 2_000
SECOND_NS = 1_000_000_000
FRAME = WireFrame(0x100, b"\x12\x34")


def changes(events: list[Event]) -> list[tuple[int, ErrorState, int, int]]:
    return [(e.node, e.state, e.tec, e.rec) for e in events if isinstance(e, StateChanged)]


def test_a_transmitter_goes_through_warning_and_passive_to_bus_off_at_96_128_and_256_and_comes_back() -> None:
    medium = Medium(faults=WireFaults(corruptions=(Corruption(0x100, Where.DATA, count=32),)))
    sender, receiver = medium.attach("sender"), medium.attach("receiver")
    medium.send(sender, FRAME, 1, 0)
    medium.send(sender, FRAME, 2, 0)
    events = medium.advance(SECOND_NS)
    mine = [change for change in changes(events) if change[0] == sender]
    assert mine == [
        (sender, ErrorState.WARNING, 96, 0),
        (sender, ErrorState.PASSIVE, 128, 0),
        (sender, ErrorState.BUS_OFF, 256, 0),
        (sender, ErrorState.ACTIVE, 0, 0),
    ]
    assert medium.node(sender).failures == 32
    assert [(e.tag, e.reason) for e in events if isinstance(e, FrameLost)] == [
        (1, Enqueued.BUS_OFF),
        (2, Enqueued.BUS_OFF),
    ]
    # The receiver counted one error a failure and stays below the warning.
    assert medium.node(receiver).confinement.rec == 32
    # Recovery on an idle bus: the error frame's own end is the first of 128 sequences of eleven recessive bits.
    off, back = (e.at_ns for e in events if isinstance(e, StateChanged) and e.node == sender and e.tec in (0, 256))
    assert back - off == (3 + 127 * 11) * BIT_NS
    medium.send(sender, FRAME, 3, SECOND_NS)
    assert [e.tag for e in medium.advance(2 * SECOND_NS) if isinstance(e, Delivered)] == [3]


def test_a_node_that_is_bus_off_takes_no_part() -> None:
    medium = Medium(faults=WireFaults(corruptions=(Corruption(0x100, Where.DATA, count=32),)))
    sender = medium.attach("sender", auto_recover=False)
    other, third = medium.attach("other"), medium.attach("third")
    medium.send(sender, FRAME, 1, 0)
    medium.advance(SECOND_NS)
    assert medium.send(sender, FRAME, 2, SECOND_NS) is Enqueued.BUS_OFF
    medium.send(other, FRAME, 3, SECOND_NS)
    events = medium.advance(2 * SECOND_NS)
    assert [e.receivers for e in events if isinstance(e, Delivered)] == [(third,)]
    assert medium.node(sender).state is ErrorState.BUS_OFF
    medium.recover(sender)
    back = medium.advance(3 * SECOND_NS)
    assert changes(back) == [(sender, ErrorState.ACTIVE, 0, 0)]


def test_recovery_among_traffic_counts_one_sequence_a_frame_and_the_idle_time_between() -> None:
    medium = Medium(faults=WireFaults(corruptions=(Corruption(0x100, Where.DATA, count=32),)))
    sender, other, _ = medium.attach("sender"), medium.attach("other", queue_limit=200), medium.attach("third")
    medium.send(sender, FRAME, 1, 0)
    events: list[Event] = []
    while not any(isinstance(e, FrameLost) for e in events):
        events = medium.advance(medium.due_ns)
    at_ns = max(e.at_ns for e in events)
    for tag in range(200):  # back to back: eleven recessive bits at the end of each, never more
        medium.send(other, WireFrame(0x200), tag, at_ns)
    events = medium.advance(at_ns + SECOND_NS)
    back = next(e for e in events if isinstance(e, StateChanged) and e.node == sender)
    frames_before = [e for e in events if isinstance(e, Delivered) and e.at_ns < back.at_ns]
    assert len(frames_before) == 127


def test_a_receiver_goes_passive_by_its_own_errors_and_returns_to_119() -> None:
    faults = WireFaults(corruptions=(Corruption(0x100, Where.CRC, receiver="noisy", count=15),))
    medium = Medium(faults=faults)
    sender, noisy, quiet = medium.attach("sender"), medium.attach("noisy"), medium.attach("quiet")
    medium.send(sender, FRAME, 1, 0)
    medium.send(sender, FRAME, 2, 0)
    events = medium.advance(SECOND_NS)
    # Nine for each error that it saw first (rules a and b): 11 make 99, 15 make 135.
    assert [change for change in changes(events) if change[0] == noisy] == [
        (noisy, ErrorState.WARNING, 0, 99),
        (noisy, ErrorState.PASSIVE, 0, 135),
        (noisy, ErrorState.WARNING, 0, 119),
    ]
    assert medium.node(noisy).confinement.rec == 118  # two good frames: to 119, then one less
    assert medium.node(quiet).confinement.rec == 15 - 2


def test_a_passive_receiver_cannot_spoil_frames_any_more() -> None:
    faults = WireFaults(corruptions=(Corruption(0x100, Where.CRC, receiver="noisy", count=17),))
    medium = Medium(faults=faults)
    sender, noisy, quiet = medium.attach("sender"), medium.attach("noisy"), medium.attach("quiet")
    for tag in (1, 2, 3):
        medium.send(sender, FRAME, tag, 0)
    events = medium.advance(SECOND_NS)
    good = [(e.tag, e.receivers) for e in events if isinstance(e, Delivered)]
    # 15 failures make it passive; the 16th and 17th error are its own loss only.
    assert good == [(1, (quiet,)), (2, (quiet,)), (3, (noisy, quiet))]
    assert medium.node(sender).failures == 15


def test_a_passive_sender_waits_eight_bits_more_than_others() -> None:
    medium = Medium(faults=WireFaults(corruptions=(Corruption(0x100, Where.DATA, count=16),)))
    sender, other = medium.attach("sender"), medium.attach("other")
    medium.send(sender, FRAME, 1, 0)
    while medium.node(sender).confinement.tec < 128:
        medium.advance(medium.due_ns)
    now_ns = medium.node(sender).earliest_ns - 8 * BIT_NS
    medium.send(other, WireFrame(0x7FF), 9, now_ns)  # less urgent, yet it starts during the eight bits
    events = medium.advance(SECOND_NS)
    assert [e.tag for e in events if isinstance(e, Delivered)] == [9, 1]


def test_counting_rules_alone() -> None:
    node = Confinement()
    node.transmitted()
    node.received()
    assert (node.tec, node.rec) == (0, 0)
    for _ in range(16):
        node.transmit_error(unacknowledged=True)
    assert (node.tec, node.state) == (128, ErrorState.PASSIVE)
    node.transmit_error(unacknowledged=True)
    assert node.tec == 128
    node.transmit_error()
    assert node.tec == 136
    for _ in range(9):
        node.transmitted()
    assert (node.tec, node.state) == (127, ErrorState.WARNING)
    for _ in range(60):
        node.receive_error(dominant_after_flag=True)
    assert node.rec == 255
    node.received()
    assert node.rec == 119
    assert not node.recessive_sequences(200)  # not bus-off: nothing to recover from


def test_who_jumps_from_event_to_event_gets_past_a_recovery_among_traffic() -> None:
    """One sequence is left to count while another node's frame is on the wire: its end is what comes next."""
    medium = Medium(faults=WireFaults(corruptions=(Corruption(0x100, Where.DATA, count=32),)))
    sender, other, _ = medium.attach("sender"), medium.attach("other", queue_limit=200), medium.attach("third")
    medium.send(sender, FRAME, 1, 0)
    at_ns, events = 0, list[Event]()
    while not any(isinstance(event, FrameLost) for event in events):
        at_ns, events = medium.advance_to_event(SECOND_NS)
    for tag in range(200):
        medium.send(other, WireFrame(0x7FF), tag, at_ns)
    told: list[Event] = []
    while at_ns < 2 * SECOND_NS:
        at_ns, events = medium.advance_to_event(2 * SECOND_NS)
        told += events
    assert (sender, ErrorState.ACTIVE, 0, 0) in changes(told)
    assert sum(isinstance(event, Delivered) for event in told) == 200
