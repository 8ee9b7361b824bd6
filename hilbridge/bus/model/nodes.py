"""The nodes of a medium: transmit queues, error counters, and what the end of an attempt means to each of them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

from hilbridge.bus.model.attempt import PartyResult
from hilbridge.bus.model.confinement import Confinement
from hilbridge.bus.model.error_frames import ErrorState
from hilbridge.bus.model.events import BusError, Delivered, Enqueued, Event, FrameLost, StateChanged
from hilbridge.bus.model.frames import WireFrame

TX_QUEUE_LIMIT = 10  # frames; what a Linux CAN interface has (txqueuelen)
BABBLE_TAG = -1  # of frames that a fault sends in a node's name


class QueueOrder(StrEnum):
    """How a controller orders what waits: first in first out as Linux does, or the most urgent first."""

    FIFO = "fifo"
    PRIORITY = "priority"


_FIFO = QueueOrder.FIFO  # asked for with every frame


class Queued(NamedTuple):
    """A waiting frame: its arbitration field, since when it waits, itself, and its sender's tag."""

    key: int
    ready_ns: int
    frame: WireFrame
    tag: int


@dataclass(slots=True, eq=False)
class Node:
    """One controller with its queue; `wire` is the number of the wire it hangs on (0: the bus, else its own stub)."""

    number: int
    name: str
    listen_only: bool
    queue_limit: int
    order: QueueOrder
    auto_recover: bool
    acknowledges: bool = True
    queue: deque[Queued] = field(default_factory=deque)
    confinement: Confinement = field(default_factory=Confinement)
    state: ErrorState = ErrorState.ACTIVE
    wire: int = 0
    earliest_ns: int = 0
    sending: Queued | None = None
    sent: int = 0
    failures: int = 0
    arbitration_losses: int = 0
    lost_frames: int = 0

    def put(self, entry: Queued) -> None:
        """Queue a frame; one that is on the wire stays the first."""
        if self.order is _FIFO or not self.queue:
            self.queue.append(entry)
            return
        position = 1 if self.sending is self.queue[0] else 0
        while position < len(self.queue) and self.queue[position].key <= entry.key:
            position += 1
        self.queue.insert(position, entry)


class Population:
    """All nodes of one medium, with the few indices that keep an undisturbed frame cheap."""

    def __init__(self) -> None:
        self.all: dict[int, Node] = {}
        self.waiting: dict[int, Node] = {}
        self.off: dict[int, Node] = {}
        self.errors = 0
        self._tainted: set[int] = set()  # those with an error counter above zero
        self._hearers: dict[int, tuple[int, ...]] = {}
        self._acknowledged: dict[int, bool] = {}

    def remove(self, number: int) -> None:
        """Forget a node and all it had queued."""
        node = self.all.pop(number)
        node.queue.clear()
        self.waiting.pop(number, None)
        self.off.pop(number, None)
        self._tainted.discard(number)
        self.changed()

    def changed(self) -> None:
        """Nodes came, went, moved to another wire or left the bus: who hears whom is open again."""
        self._hearers.clear()
        self._acknowledged.clear()

    def listeners(self, wire: int, senders: tuple[Node, ...]) -> list[Node]:
        """Those on this wire that take part in its traffic and do not send."""
        return [
            node
            for node in self.all.values()
            if node.wire == wire and not node.confinement.sequences_left and node not in senders
        ]

    def is_acknowledged(self, wire: int, senders: tuple[Node, ...]) -> bool:
        """Whether anybody on this wire acknowledges a frame of these senders."""
        number = senders[0].number
        found = self._acknowledged.get(number) if len(senders) == 1 else None
        if found is None:
            found = any(node.acknowledges for node in self.listeners(wire, senders))
            if len(senders) == 1:
                self._acknowledged[number] = found
        return found

    def hearers(self, wire: int, senders: tuple[Node, ...]) -> tuple[int, ...]:
        """Numbers of all who receive an undisturbed frame."""
        if len(senders) > 1:
            return tuple(node.number for node in self.listeners(wire, senders))
        number = senders[0].number
        found = self._hearers.get(number)
        if found is None:
            found = self._hearers[number] = tuple(node.number for node in self.listeners(wire, senders))
        return found

    def settle(self, wire: int, senders: tuple[Node, ...], at_ns: int, events: list[Event]) -> None:
        """An undisturbed frame is over."""
        hearers = self.hearers(wire, senders)
        for position, node in enumerate(senders):
            self._sent(node, at_ns, () if position else hearers, events)
        if not self._tainted:
            return
        for node in senders:
            node.confinement.transmitted()
            self._note(node, at_ns, events)
        for number in hearers:
            if number in self._tainted:
                node = self.all[number]
                node.confinement.received()
                self._note(node, at_ns, events)

    def _sent(self, node: Node, at_ns: int, receivers: tuple[int, ...], events: list[Event]) -> None:
        entry, node.sending = node.sending, None
        if entry is None:
            return
        node.sent += 1
        if node.queue and node.queue[0] is entry:
            node.queue.popleft()
            if not node.queue:
                self.waiting.pop(node.number, None)
        events.append(Delivered(at_ns, entry.frame, node.number, entry.tag, receivers))

    def settle_disturbed(
        self, senders: tuple[Node, ...], parties: dict[int, PartyResult], at_ns: int, events: list[Event]
    ) -> None:
        """An attempt in which somebody saw an error is over."""
        self.errors += 1
        entry = senders[0].sending
        assert entry is not None
        receivers = tuple(
            number for number, result in parties.items() if result.done and all(number != s.number for s in senders)
        )
        errors = {number: result.error for number, result in parties.items() if result.error is not None}
        first = senders[0]
        for node in senders:
            if parties[node.number].done:
                self._sent(node, at_ns, receivers if node is first else (), events)
            else:
                node.failures += 1
                node.sending = None
        if receivers and not parties[first.number].done:
            events.append(Delivered(at_ns, entry.frame, first.number, entry.tag, receivers, sent=False))
        events.append(BusError(at_ns, entry.frame, first.number, errors))
        for number, result in parties.items():
            party = self.all.get(number)
            if party is not None:
                self._count(party, result, is_sender=any(node is party for node in senders))
                self._note(party, at_ns, events)

    def _count(self, node: Node, result: PartyResult, *, is_sender: bool) -> None:
        confinement = node.confinement
        for _ in range(result.counts_transmit):
            confinement.transmit_error(unacknowledged=result.unacknowledged)
        for repeat in range(result.counts_receive):
            confinement.receive_error(dominant_after_flag=result.dominant_after_flag and repeat == 0)
        if result.done and result.error is None:
            if is_sender:
                confinement.transmitted()
            else:
                confinement.received()

    def _note(self, node: Node, at_ns: int, events: list[Event]) -> None:
        """Keep the indices true to the node's counters; tell a change of state."""
        confinement = node.confinement
        if (confinement.tec or confinement.rec) and node.number in self.all:
            self._tainted.add(node.number)
        else:
            self._tainted.discard(node.number)
        state = confinement.state
        if state is node.state:
            return
        node.state = state
        events.append(StateChanged(at_ns, node.number, state, confinement.tec, confinement.rec))
        if state is ErrorState.BUS_OFF and node.number not in self.off:
            self._leave_bus(node, at_ns, events)

    def _leave_bus(self, node: Node, at_ns: int, events: list[Event]) -> None:
        self.off[node.number] = node
        node.confinement.recovering = node.auto_recover
        for entry in node.queue:  # Linux, too, throws the queue away when the carrier goes
            node.lost_frames += 1
            events.append(FrameLost(at_ns, node.number, entry.tag, Enqueued.BUS_OFF))
        node.queue.clear()
        self.waiting.pop(node.number, None)
        self.changed()

    def count_recessive(self, nodes: Iterable[Node], sequences: int, at_ns: int, events: list[Event]) -> None:
        """These bus-off nodes saw so many more sequences of eleven recessive bits, the last ending at `at_ns`."""
        for node in list(nodes):
            if node.confinement.recessive_sequences(sequences):
                del self.off[node.number]
                node.earliest_ns = max(node.earliest_ns, at_ns)  # a babbling one begins anew then, not before
                self.changed()
                self._note(node, at_ns, events)
