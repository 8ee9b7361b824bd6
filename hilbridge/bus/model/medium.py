"""A CAN bus as a pure, deterministic model: exact frame lengths, bitwise arbitration, error confinement, bus-off.

Time is an argument and must never fall. A frame is on the wire from its first bit to the end of its end of frame;
three bits of intermission later the next may start, and of all that wait then the lowest arbitration field goes.
Undisturbed frames cost one table-driven count of their bits; disturbed ones are played bit by bit (`attempt`). While
nothing is due, letting time pass costs a comparison.

Left out: bit timing and resynchronisation (all clocks are equal), overload frames asked for by slow controllers, and
classical controllers that destroy FD frames. A cut wire counts from the next frame on.
"""

from __future__ import annotations

from hilbridge.bus.model.bits import INTERMISSION_BITS, frame_length
from hilbridge.bus.model.confinement import RECOVERY_SEQUENCE_BITS
from hilbridge.bus.model.disturbed import flips_of, play, unacknowledged
from hilbridge.bus.model.events import Enqueued, Event
from hilbridge.bus.model.faults import FOREVER_NS, FaultState, WireFaults
from hilbridge.bus.model.frames import WireFrame, arbitration_key, frame_fault
from hilbridge.bus.model.nodes import BABBLE_TAG, TX_QUEUE_LIMIT, Node, Population, Queued, QueueOrder
from hilbridge.bus.model.segment import NS_PER_S, Offer, Transmission, Wire

_QUEUED = Enqueued.QUEUED
SUSPEND_BITS = 8  # an error-passive sender waits this long after intermission


class Medium:
    """One bus with its nodes. See the module for what it models."""

    def __init__(self, bitrate: int = 500_000, data_bitrate: int = 2_000_000, faults: WireFaults | None = None) -> None:
        """An idle bus at time 0. Bit rates in bit/s. Raises ValueError for rates below 1."""
        if bitrate < 1 or data_bitrate < 1:
            raise ValueError("a bit rate is at least 1 bit/s")
        self.bitrate = bitrate
        self.data_bitrate = data_bitrate
        self.busy_ns = 0  # of the main wire, intermissions included: bus load is its growth over time
        self.nodes = Population()
        self._wires: dict[int, Wire] = {0: Wire(0, 0)}
        self._next_number = 1
        self._now_ns = 0
        # Before this time `advance` has nothing to do: exact after each call, 0 once something has changed.
        self.due_ns = 0
        self._moved = False
        self._bit_ns = NS_PER_S // bitrate if NS_PER_S % bitrate == 0 else 0
        self._intermission_ns = self.duration_ns(INTERMISSION_BITS)
        self._sequence_ns = self.duration_ns(RECOVERY_SEQUENCE_BITS)
        self.use_faults(faults or WireFaults())

    def attach(
        self,
        name: str,
        *,
        listen_only: bool = False,
        queue_limit: int = TX_QUEUE_LIMIT,
        order: QueueOrder = QueueOrder.FIFO,
        auto_recover: bool = True,
    ) -> int:
        """Connect a node; gives its number. `auto_recover` False: after bus-off it waits for `recover`."""
        number, self._next_number = self._next_number, self._next_number + 1
        node = Node(number, name, listen_only, queue_limit, order, auto_recover)
        self.nodes.all[number] = node
        self._place(node)
        return number

    def detach(self, number: int) -> None:
        """Take a node off with all it had queued; a frame it has on the wire still ends there."""
        self.nodes.remove(number)
        self._wires.pop(number, None)  # the stub of a node that was cut off: nobody else hangs on it

    def rename(self, number: int, name: str) -> None:
        """Give a node the name by which faults know it."""
        node = self.nodes.all[number]
        node.name = name
        self._place(node)

    def recover(self, number: int) -> None:
        """Let a node that is bus-off begin to wait for 128 sequences of eleven recessive bits; call after `advance`."""
        self.nodes.all[number].confinement.recovering = True
        self.due_ns = 0

    def node(self, number: int) -> Node:
        """The node's counters and state, to look at."""
        return self.nodes.all[number]

    def queued(self, number: int) -> int:
        """Frames in a node's transmit queue, the one on the wire among them."""
        return len(self.nodes.all[number].queue)

    def use_faults(self, faults: WireFaults) -> None:
        """Exchange the faults; their counters and random numbers begin anew."""
        self.faults = faults
        self.fault_state = FaultState(faults, self._now_ns)
        self._disturbed = faults.bit_error_rate > 0 or bool(faults.corruptions)
        self._script = self.fault_state if faults.babbles or faults.stalls else None
        edges = {edge for cut in faults.cuts for edge in (cut.from_ns, cut.until_ns)}
        self._edges = sorted(edge for edge in edges if edge > self._now_ns)
        self.due_ns = 0
        for node in self.nodes.all.values():
            self._place(node)

    def _place(self, node: Node) -> None:
        """Hang the node on the bus or, while it is cut off, on a stub of its own."""
        node.acknowledges = not node.listen_only and node.name not in self.faults.no_ack
        cut = self.fault_state.is_cut(node.name, self._now_ns)
        wire = node.number if cut else 0
        if node.wire != wire:  # it takes part from now on, and not in what this wire's silence has left free before
            node.wire, node.earliest_ns = wire, max(node.earliest_ns, self._now_ns)
        if cut:
            self.fault_state.effects["cut"] += 1
            self._wires.setdefault(node.number, Wire(node.number, self._now_ns))
        self.nodes.changed()
        self.due_ns = 0

    def duration_ns(self, nominal_bits: int, data_bits: int = 0) -> int:
        """How long so many bits last at the two bit rates."""
        duration = nominal_bits * self._bit_ns or nominal_bits * NS_PER_S // self.bitrate
        return duration + data_bits * NS_PER_S // self.data_bitrate if data_bits else duration

    def send(self, number: int, frame: WireFrame, tag: int, now_ns: int) -> Enqueued:
        """Put a frame in the node's transmit queue at `now_ns`; it takes part in arbitration from then on."""
        node = self.nodes.all[number]
        if node.listen_only:
            return Enqueued.LISTEN_ONLY
        if frame_fault(frame) is not None:
            return Enqueued.BAD_FRAME
        if node.confinement.sequences_left:
            return Enqueued.BUS_OFF
        if len(node.queue) >= node.queue_limit:
            return Enqueued.FULL
        node.put(Queued(arbitration_key(frame), now_ns, frame, tag))
        self.nodes.waiting[number] = node
        self.due_ns = 0
        return _QUEUED

    def hasten(self, now_ns: int) -> None:
        """Frames that would be ready only later are ready now: whoever's clock gave them their time has set it back."""
        for node in self.nodes.waiting.values():
            if node.queue[-1].ready_ns > now_ns:
                for place, entry in enumerate(node.queue):
                    if entry.ready_ns > now_ns:  # none of these is on the wire
                        node.queue[place] = entry._replace(ready_ns=now_ns)
                self.due_ns = 0

    def advance(self, now_ns: int) -> list[Event]:
        """Let the bus run up to and including `now_ns`; gives what happened, in order of time."""
        events: list[Event] = []
        if now_ns < self.due_ns and not self.nodes.off:  # nodes that are off count the idle time, whoever looks
            self._now_ns = now_ns
            return events
        while self._edges and self._edges[0] <= now_ns:
            edge = self._edges.pop(0)
            self._run_all(edge - 1, events)
            self._now_ns = edge
            for node in self.nodes.all.values():
                self._place(node)
        due_ns = self._run_all(now_ns, events)
        self._now_ns = now_ns
        self.due_ns = min(due_ns, self._edges[0]) if self._edges else due_ns
        return events

    def advance_to_event(self, limit_ns: int | None) -> tuple[int, list[Event]]:
        """Let the bus run to the first thing that happens, at most to `limit_ns`. For a caller that can jump in time.

        Gives the time reached and what happened then; FOREVER_NS where there is no limit and nothing under way.
        """
        while True:
            due_ns = max(self.due_ns, self._now_ns)
            if limit_ns is None:
                if due_ns == FOREVER_NS:
                    return FOREVER_NS, []
            elif due_ns > limit_ns:
                return limit_ns, self.advance(limit_ns)
            events = self.advance(due_ns)
            if events:
                return self._now_ns, events

    def _run_all(self, now_ns: int, events: list[Event]) -> int:
        """Let every wire run; gives when the first of them has something to do again."""
        if len(self._wires) == 1:
            return self._run(self._wires[0], now_ns, events)
        while True:
            self._moved = False
            due_ns = min([self._run(wire, now_ns, events) for wire in list(self._wires.values())])
            if not self._moved:
                break
        events.sort(key=lambda event: event.at_ns)
        return due_ns

    # One wire

    def _run(self, wire: Wire, now_ns: int, events: list[Event]) -> int:
        """Let one wire run; gives when its transmission ends, the next begins, or a node is back from bus-off."""
        while True:
            current = wire.current
            if current is not None:
                if current.end_ns > now_ns:
                    return current.end_ns
                wire.current = None
                self._finish(wire, current, events)
                continue
            if not (self.nodes.waiting or self._script or self.nodes.off):
                return FOREVER_NS
            offers = wire.offers(self.nodes, self._script)
            due_ns = start_ns = wire.start_ns(offers) if offers else FOREVER_NS
            if self.nodes.off:
                if wire.count_idle(self.nodes, min(start_ns, now_ns), self._sequence_ns, events):
                    continue  # who is back may have something to send
                due_ns = min(start_ns, wire.first_back_ns(self.nodes, self._sequence_ns))
            if start_ns > now_ns:
                return due_ns
            self._begin(wire, start_ns, offers)

    def _begin(self, wire: Wire, start_ns: int, offers: list[Offer]) -> None:
        """Put the winner of those who are ready by `start_ns` on the wire."""
        if len(offers) == 1:
            _, sender, entry = offers[0]
            sender.sending = entry
            senders: tuple[Node, ...] = (sender,)
        else:
            senders = self._arbitrate([offer for offer in offers if offer[0] <= start_ns])
        wire.current = self._transmission(wire, start_ns, senders)
        if wire.number == 0:
            self.busy_ns += wire.current.free_ns - start_ns

    def _arbitrate(self, contenders: list[Offer]) -> tuple[Node, ...]:
        """The nodes whose arbitration field is the lowest: one, unless two nodes send one identifier."""
        lowest = min(entry.key for _, _, entry in contenders)
        senders = []
        for _, node, entry in contenders:
            if entry.key == lowest:
                node.sending = entry
                senders.append(node)
            else:
                node.arbitration_losses += 1
        return tuple(senders)

    def _transmission(self, wire: Wire, start_ns: int, senders: tuple[Node, ...]) -> Transmission:
        entry = senders[0].sending
        assert entry is not None
        if entry.tag == BABBLE_TAG:
            self.fault_state.effects["babble"] += 1
        length = frame_length(entry.frame)
        flips: dict[int, int | None] = {}
        if self._disturbed:
            listeners = self.nodes.listeners(wire.number, senders)
            flips = flips_of(self.fault_state, entry.frame, listeners, length, start_ns)
        same = len(senders) == 1 or all(node.sending and node.sending.frame == entry.frame for node in senders)
        nominal_bits, data_bits, _ = length
        parties = None
        if flips or not same:
            listeners = self.nodes.listeners(wire.number, senders)
            parties, nominal_bits, data_bits = play(senders, listeners, flips)
        elif not self.nodes.is_acknowledged(wire.number, senders):
            parties, more_bits = unacknowledged(senders, self.nodes.listeners(wire.number, senders))
            nominal_bits += more_bits
        end_ns = start_ns + self.duration_ns(nominal_bits, data_bits)
        return Transmission(end_ns, end_ns + self._intermission_ns, senders, parties)

    def _finish(self, wire: Wire, over: Transmission, events: list[Event]) -> None:
        wire.idle_from_ns = wire.free_ns = over.free_ns
        if over.parties is None:
            self.nodes.settle(wire.number, over.senders, over.end_ns, events)
        else:
            self.nodes.settle_disturbed(over.senders, over.parties, over.end_ns, events)
        for node in over.senders:
            if node.confinement.is_passive:
                node.earliest_ns = over.free_ns + self.duration_ns(SUSPEND_BITS)
            if (
                node.wire != wire.number
            ):  # it was moved to another wire meanwhile, which may have been looked at already
                node.earliest_ns = max(node.earliest_ns, over.free_ns)
                self._moved = True
        if self.nodes.off:  # the end of any frame and of any error frame, with intermission, is eleven recessive bits
            self.nodes.count_recessive(wire.recovering(self.nodes), 1, over.free_ns, events)
