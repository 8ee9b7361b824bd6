"""A simulated bus within one process: no threads, no sockets, and time is whatever clock is handed in."""

from __future__ import annotations

from collections import deque
from typing import Protocol

from hilbridge.bus.model.error_frames import write_error_frame
from hilbridge.bus.model.events import BusError, Delivered, Enqueued, Event, StateChanged
from hilbridge.bus.model.faults import FOREVER_NS
from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.model.medium import Medium
from hilbridge.bus.simulated.protocol import Arrival

_INBOX_LIMIT = 8192
_QUEUED = Enqueued.QUEUED


class Clock(Protocol):
    """Time for a network within one process."""

    def now_ns(self) -> int:
        """The present; never falls."""

    def wait_until(self, when_ns: int) -> None:
        """Come back at `when_ns` or later."""


class VirtualClock:
    """Time passes only when somebody waits: the same run every time, as fast as the machine can."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """The present."""
        return self._now_ns

    def wait_until(self, when_ns: int) -> None:
        """Let time pass."""
        self._now_ns = max(self._now_ns, when_ns)


class NothingToCome(RuntimeError):
    """Someone waits without end on a bus on which nothing will ever happen."""


class Network:
    """A medium with its nodes' inboxes, for `SimulatedBus` and `can.Bus(interface="hilsim", channel=network)`."""

    def __init__(self, medium: Medium | None = None, clock: Clock | None = None) -> None:
        self.medium = medium or Medium()
        self.clock: Clock = clock or VirtualClock()
        self._stations: dict[int, Station] = {}

    def attach(
        self, node: str = "", *, listen_only: bool = False, receive_own: bool = False, bus_errors: bool = False
    ) -> Station:
        """A new node of this network."""
        number = self.medium.attach(node or f"station {len(self._stations) + 1}", listen_only=listen_only)
        station = Station(self, number, receive_own=receive_own, bus_errors=bus_errors)
        self._stations[number] = station
        return station

    def detach(self, number: int) -> None:
        """Take a node off."""
        if self._stations.pop(number, None) is not None:
            self.medium.detach(number)

    def pump(self) -> None:
        """Let the bus catch up with the clock and put what arrived into the inboxes."""
        events = self.medium.advance(self.clock.now_ns())
        if events:
            self._handle(events)

    def _handle(self, events: list[Event]) -> None:
        for event in events:
            if type(event) is Delivered:
                self._deliver(event)
            else:
                self._tell(event)

    def _deliver(self, event: Delivered) -> None:
        stations = self._stations
        arrival = Arrival(event.frame, event.at_ns)
        for number in event.receivers:
            station = stations.get(number)
            if station is not None:
                station.put(arrival)
        sender = stations.get(event.sender)
        if sender is not None and sender.receive_own and event.sent:
            sender.put(Arrival(event.frame, event.at_ns, own=True))

    def _tell(self, event: Event) -> None:
        if isinstance(event, StateChanged):
            station = self._stations.get(event.node)
            if station is not None:
                station.state = event.state
                station.put_error(event.at_ns, *write_error_frame(event.state, event.tec, event.rec))
        elif isinstance(event, BusError):
            for number, kind in event.errors.items():
                station = self._stations.get(number)
                if station is None or not station.bus_errors:
                    continue
                confinement = self.medium.node(number).confinement
                sending = number == event.sender
                classes, data = write_error_frame(None, confinement.tec, confinement.rec, kind=kind, sending=sending)
                station.put_error(event.at_ns, classes, data)

    def step(self, deadline_ns: int | None) -> bool:
        """Wait for the next thing to happen, at most until `deadline_ns`. False where that time has come.

        Raises NothingToCome where there is neither a deadline nor anything that could happen.
        """
        now_ns = self.clock.now_ns()
        if deadline_ns is not None and now_ns >= deadline_ns:
            self.pump()
            return False
        if type(self.clock) is VirtualClock:  # nobody else can act meanwhile: jump to what happens first
            reached_ns, events = self.medium.advance_to_event(deadline_ns)
        else:
            reached_ns, events = now_ns, self.medium.advance(now_ns)
            if not events:
                due_ns = self.medium.due_ns
                reached_ns = due_ns if deadline_ns is None else min(due_ns, deadline_ns)
        if reached_ns == FOREVER_NS:
            raise NothingToCome("waiting without end on a simulated bus on which nobody sends")
        self.clock.wait_until(reached_ns)
        self._handle(events)
        return True


class Station:
    """One node's transmit queue and inbox, with the methods of `client.BusClient`.

    `inbox` has what had arrived when the network was last pumped, `state` that of error confinement then.
    """

    def __init__(self, network: Network, number: int, *, receive_own: bool, bus_errors: bool) -> None:
        self.network = network
        self.number = number
        self.receive_own = receive_own
        self.bus_errors = bus_errors
        self.dropped = 0
        self.state = network.medium.node(number).state
        self.inbox: deque[Arrival] = deque()
        self._tag = 0
        medium = network.medium
        self.bitrate, self.data_bitrate = medium.bitrate, medium.data_bitrate

    def put(self, arrival: Arrival) -> None:
        """Into the inbox, or lost and counted."""
        if len(self.inbox) >= _INBOX_LIMIT:
            self.dropped += 1
            return
        self.inbox.append(arrival if not self.dropped else arrival._replace(dropped=self.dropped))

    def put_error(self, at_ns: int, classes: int, data: bytes) -> None:
        """An error frame into the inbox."""
        self.put(Arrival(WireFrame(classes, data), at_ns, error=True))

    def receive(self) -> Arrival | None:
        """One frame, or None when none has arrived by now."""
        if not self.inbox:
            self.network.pump()
        return self.inbox.popleft() if self.inbox else None

    def drain(self) -> list[Arrival]:
        """All of the inbox."""
        arrivals = list(self.inbox)
        self.inbox.clear()
        return arrivals

    def receive_within(self, timeout_s: float | None) -> Arrival | None:
        """One frame, letting at most so much time pass until it has arrived. Raises NothingToCome."""
        return self.receive_until(None if timeout_s is None else self.network.clock.now_ns() + int(timeout_s * 1e9))

    def receive_until(self, deadline_ns: int | None) -> Arrival | None:
        """One frame, letting time pass at most until then (None: as long as it takes). Raises NothingToCome."""
        inbox = self.inbox
        if not inbox:
            step = self.network.step
            while step(deadline_ns) and not inbox:
                pass
        return inbox.popleft() if inbox else None

    def send(self, frame: WireFrame, timeout_s: float = 0.0) -> Enqueued:
        """Queue a frame; where the queue is full, let at most so much time pass for room."""
        network = self.network
        self._tag += 1
        result = network.medium.send(self.number, frame, self._tag, network.clock.now_ns())
        if result is not _QUEUED:
            # Only now does the bus catch up: it must not start a frame between two that are sent at one time.
            network.pump()
            result = network.medium.send(self.number, frame, self._tag, network.clock.now_ns())
        if result is Enqueued.FULL and timeout_s > 0:
            deadline_ns = network.clock.now_ns() + int(timeout_s * 1e9)
            while result is Enqueued.FULL and network.step(deadline_ns):
                result = network.medium.send(self.number, frame, self._tag, network.clock.now_ns())
        return result

    def refresh(self) -> None:
        """Let the bus catch up with the clock."""
        self.network.pump()

    def recover(self) -> None:
        """Leave bus-off after 128 sequences of eleven recessive bits, where that does not happen by itself."""
        self.network.pump()
        self.network.medium.recover(self.number)

    def close(self) -> None:
        """Leave the network, with all that was queued."""
        self.network.detach(self.number)
