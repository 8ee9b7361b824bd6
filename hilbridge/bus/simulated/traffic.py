"""Carries what happens on a simulated bus to its clients: frames, error frames, credits, states."""

from __future__ import annotations

from hilbridge.bus.model.error_frames import write_error_frame
from hilbridge.bus.model.events import BusError, Delivered, Enqueued, Event, FrameLost, StateChanged
from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.model.medium import Medium
from hilbridge.bus.model.nodes import BABBLE_TAG
from hilbridge.bus.simulated.handshake import Client
from hilbridge.bus.simulated.protocol import Flag, Kind, Record, frame_record


class Traffic:
    """Events of the medium into records for clients. `slip_ns`: how much the bus's time is behind the clock's."""

    def __init__(self, medium: Medium, by_node: dict[int, Client]) -> None:
        self.slip_ns = 0
        self._medium = medium
        self._by_node = by_node

    def credit(self, number: int, sequence: int, result: Enqueued) -> None:
        """Tell a sender that one of its frames has left its transmit queue, and why if not onto the wire."""
        client = self._by_node.get(number)
        if client is None or client.credits is None or client.deaf or sequence == BABBLE_TAG:
            return
        reason = b"" if result is Enqueued.QUEUED else result.encode()
        client.credits.push(Record(Kind.SENT, sequence=sequence, data=reason).pack(), keep=True)

    def carry(self, event: Event) -> None:
        match event:
            case Delivered():
                self._on_delivered(event)
            case FrameLost():
                self.credit(event.node, event.tag, event.reason)
            case StateChanged():
                self._on_state(event)
            case BusError():
                self._on_error(event)

    def _on_state(self, event: StateChanged) -> None:
        client = self._by_node.get(event.node)
        if client is None or client.deaf:
            return
        classes, data = write_error_frame(event.state, event.tec, event.rec)
        self._error_frame(client, event.at_ns + self.slip_ns, classes, data)
        if client.credits is not None:
            state = Record(Kind.STATE, sequence=event.tec, dropped=event.rec, data=event.state.encode())
            client.credits.push(state.pack())

    def _on_error(self, event: BusError) -> None:
        for number, kind in event.errors.items():
            client = self._by_node.get(number)
            if client is None or client.deaf or not client.flags & Flag.BUS_ERRORS:
                continue
            node = self._medium.node(number)
            classes, data = write_error_frame(
                None, node.confinement.tec, node.confinement.rec, kind=kind, sending=number == event.sender
            )
            self._error_frame(client, event.at_ns + self.slip_ns, classes, data)

    def _error_frame(self, client: Client, at_ns: int, classes: int, data: bytes) -> None:
        frame = WireFrame(classes, data)
        client.deliveries.push(frame_record(frame, at_ns, 0, client.deliveries.dropped, Flag.ERROR).pack())

    def _on_delivered(self, event: Delivered) -> None:
        raw = None
        for node in event.receivers:
            client = self._by_node.get(node)
            if client is None or client.deaf:
                continue
            dropped = client.deliveries.dropped
            if raw is None or dropped:
                packed = frame_record(event.frame, event.at_ns + self.slip_ns, 0, dropped).pack()
                raw = packed if not dropped else raw
            else:
                packed = raw
            client.deliveries.push(packed)
        sender = self._by_node.get(event.sender)
        if sender is None or sender.deaf or not event.sent:
            return
        if sender.flags & Flag.RECEIVE_OWN:
            own = frame_record(event.frame, event.at_ns + self.slip_ns, 0, sender.deliveries.dropped, Flag.OWN)
            sender.deliveries.push(own.pack())
        self.credit(event.sender, event.tag, Enqueued.QUEUED)
