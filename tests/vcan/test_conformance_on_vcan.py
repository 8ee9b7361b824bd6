"""One trace through a kernel bus and through the medium: the same frames for every receiver, in the orders predicted."""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import NamedTuple

import can

from hilbridge.bus.model.bits import INTERMISSION_BITS, frame_length
from hilbridge.bus.model.frames import arbitration_key
from hilbridge.bus.model.medium import Medium
from hilbridge.bus.simulated.interface import SimulatedBus, wire_frame_of
from hilbridge.bus.simulated.network import Network, VirtualClock

BIT_NS = 2_000
NAMES = ("one", "two", "three", "listener")


class Sent(NamedTuple):
    at_ns: int
    sender: str
    message: can.Message


def make_trace(seed: int, count: int) -> list[Sent]:
    """Bursts from three senders, so that frames do compete; never more waiting than a transmit queue holds."""
    dice = random.Random(seed)
    trace = []
    at_ns = 0
    for burst in range(count // 6):
        at_ns += 3_000_000
        for number in range(6):
            extended = dice.random() < 0.3
            can_id = dice.getrandbits(29) if extended else dice.getrandbits(11)
            data = bytes([burst % 256, number, *dice.randbytes(dice.randrange(7))])
            message = can.Message(arbitration_id=can_id, is_extended_id=extended, data=data)
            trace.append(Sent(at_ns + dice.choice((0, 0, 50_000)), NAMES[number % 3], message))
    return sorted(trace, key=lambda sent: sent.at_ns)


def signature(message: can.Message) -> tuple[int, bool, bytes]:
    return message.arbitration_id, message.is_extended_id, bytes(message.data)


def drain(bus: can.BusABC, timeout: float = 0.0) -> list[tuple[int, bool, bytes]]:
    found = []
    while (message := bus.recv(timeout)) is not None:
        found.append(signature(message))
    return found


def through_vcan(trace: Sequence[Sent]) -> dict[str, list[tuple[int, bool, bytes]]]:
    buses = {name: can.Bus(interface="socketcan", channel="vcan0") for name in NAMES}
    heard: dict[str, list[tuple[int, bool, bytes]]] = {name: [] for name in NAMES}
    for number, sent in enumerate(trace):
        buses[sent.sender].send(sent.message)
        if number % 50 == 49:
            for name, bus in buses.items():
                heard[name] += drain(bus)
    for name, bus in buses.items():
        heard[name] += drain(bus, 0.1)
        bus.shutdown()
    return heard


def through_medium(trace: Sequence[Sent]) -> dict[str, list[tuple[int, bool, bytes]]]:
    clock = VirtualClock()
    network = Network(Medium(), clock)
    buses = {name: SimulatedBus(network, node=name) for name in NAMES}
    heard: dict[str, list[tuple[int, bool, bytes]]] = {name: [] for name in NAMES}
    for sent in trace:
        if sent.at_ns > clock.now_ns():  # looking at the bus lets it start what waits: not between two of one time
            clock.wait_until(sent.at_ns)
            for name, bus in buses.items():
                heard[name] += drain(bus)
        buses[sent.sender].send(sent.message)
    for name, bus in buses.items():
        heard[name] += drain(bus, 1.0)
        bus.shutdown()
    return heard


def predicted(trace: Sequence[Sent]) -> list[Sent]:
    """The order on the wire, by the rule alone: of the queues' heads that wait when the bus is free, the lowest goes."""
    queues = {name: [sent for sent in trace if sent.sender == name] for name in NAMES}
    order = []
    free_ns = 0
    while any(queues.values()):
        heads = [queue[0] for queue in queues.values() if queue]
        start_ns = max(free_ns, min(head.at_ns for head in heads))
        frames = {id(head): wire_frame_of(head.message) for head in heads}
        winner = min((h for h in heads if h.at_ns <= start_ns), key=lambda head: arbitration_key(frames[id(head)]))
        queues[winner.sender].remove(winner)
        order.append(winner)
        bits = frame_length(frames[id(winner)]).nominal_bits + INTERMISSION_BITS
        free_ns = start_ns + bits * BIT_NS
    return order


def test_the_same_frames_reach_every_receiver_and_only_arbitration_changes_their_order() -> None:
    trace = make_trace(7, 3000)
    kernel, medium = through_vcan(trace), through_medium(trace)
    order = predicted(trace)
    for name in NAMES:
        assert kernel[name] == [signature(sent.message) for sent in trace if sent.sender != name]
        assert medium[name] == [signature(sent.message) for sent in order if sent.sender != name]
        assert sorted(medium[name]) == sorted(kernel[name])
    moved = sum(one is not other for one, other in zip(trace, order, strict=True))
    assert moved > len(trace) // 10  # the trace does compete for the bus
