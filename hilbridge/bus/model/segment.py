"""One connected piece of bus: what is on it, who wants it next, how long it has been quiet."""

from __future__ import annotations

from typing import NamedTuple

from hilbridge.bus.model.attempt import PartyResult
from hilbridge.bus.model.events import Event
from hilbridge.bus.model.faults import FOREVER_NS, FaultState
from hilbridge.bus.model.frames import WireFrame, arbitration_key
from hilbridge.bus.model.nodes import BABBLE_TAG, Node, Population, Queued

NS_PER_S = 1_000_000_000


class Transmission(NamedTuple):
    """What is on a wire, over for its senders at `end_ns`; the next may start at `free_ns`.

    `parties` tells what became of each node where the attempt was disturbed; None: everybody received it.
    """

    end_ns: int
    free_ns: int
    senders: tuple[Node, ...]
    parties: dict[int, PartyResult] | None


class Offer(NamedTuple):
    """A node that wants to send `entry`, from `ready_ns` on."""

    ready_ns: int
    node: Node
    entry: Queued


class Wire:
    """The main bus (number 0), or the stub of a node that is cut off (the node's number)."""

    __slots__ = ("current", "free_ns", "idle_from_ns", "number")

    def __init__(self, number: int, now_ns: int) -> None:
        self.number = number
        self.free_ns = now_ns
        self.idle_from_ns = now_ns
        self.current: Transmission | None = None

    def offers(self, nodes: Population, script: FaultState | None) -> list[Offer]:
        """What the nodes on this wire want to send. `script` holds babbling and stalls, where there are any."""
        if script is not None:
            return self._scripted_offers(nodes, script)
        waiting = nodes.waiting
        if len(waiting) == 1:  # the usual case, and the cheap one
            (node,) = waiting.values()
            if node.wire != self.number or node.sending is not None:
                return []
            head = node.queue[0]
            return [Offer(head.ready_ns if head.ready_ns > node.earliest_ns else node.earliest_ns, node, head)]
        return [
            Offer(max(node.queue[0].ready_ns, node.earliest_ns), node, node.queue[0])
            for node in waiting.values()
            if node.wire == self.number and node.sending is None
        ]

    def start_ns(self, offers: list[Offer]) -> int:
        """When the first of these, of which there is one at least, can begin."""
        ready_ns = offers[0].ready_ns if len(offers) == 1 else min(offer.ready_ns for offer in offers)
        return ready_ns if ready_ns > self.free_ns else self.free_ns

    def _scripted_offers(self, nodes: Population, script: FaultState) -> list[Offer]:
        offers = []
        for node in nodes.all.values():
            if node.wire != self.number or node.confinement.sequences_left or node.sending is not None:
                continue
            from_ns = max(self.free_ns, node.earliest_ns)
            head = node.queue[0] if node.queue else None
            ready_ns = 0 if head is None else script.stalled_until(node.name, max(head.ready_ns, from_ns))
            babble = script.next_babble(node.name, from_ns)
            if babble is not None and (head is None or babble[0] <= ready_ns):
                frame = WireFrame(babble[1].can_id, babble[1].data)
                entry = Queued(arbitration_key(frame), babble[0], frame, BABBLE_TAG)
                offers.append(Offer(babble[0], node, entry))
            elif head is not None:
                offers.append(Offer(ready_ns, node, head))
        return offers

    def recovering(self, nodes: Population) -> list[Node]:
        """The nodes on this wire that are bus-off and count recessive bits."""
        return [node for node in nodes.off.values() if node.wire == self.number and node.confinement.recovering]

    def back_ns(self, node: Node, sequence_ns: int) -> int:
        """When a recovering node is back, should the wire stay idle; `sequence_ns` is how long eleven bits last."""
        return self.idle_from_ns + sequence_ns * node.confinement.sequences_left

    def first_back_ns(self, nodes: Population, sequence_ns: int) -> int:
        """When the first of the recovering nodes is back, should the wire stay idle; FOREVER_NS where there is none."""
        return min([self.back_ns(node, sequence_ns) for node in self.recovering(nodes)], default=FOREVER_NS)

    def count_idle(self, nodes: Population, until_ns: int, sequence_ns: int, events: list[Event]) -> bool:
        """Let recovering nodes count the recessive bits of a wire that was idle until then; whether one came back."""
        sequences = (until_ns - self.idle_from_ns) // sequence_ns
        if sequences <= 0:
            return False
        off = len(nodes.off)
        for node in self.recovering(nodes):
            nodes.count_recessive([node], sequences, min(self.back_ns(node, sequence_ns), until_ns), events)
        self.idle_from_ns += sequences * sequence_ns
        return len(nodes.off) < off
