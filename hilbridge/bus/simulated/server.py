"""The process that owns a simulated bus: it runs the medium in real time and carries frames to and from its clients.

`python -m hilbridge.bus.simulated.server NAME` is started by the first client that finds no bus of that name, detached, so that
no client's death takes the bus down; it leaves by itself when nobody has been attached for a while.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import json
import os
import socket
import sys
import time
from collections.abc import Callable

from hilbridge.bus.model.events import Enqueued
from hilbridge.bus.model.medium import Medium
from hilbridge.bus.simulated.control import answer
from hilbridge.bus.simulated.handshake import Client, Reception
from hilbridge.bus.simulated.protocol import BusNameTaken, Kind, Record, claim, in_parts, record_frame
from hilbridge.bus.simulated.requests import REQUEST_LIMIT_BYTES
from hilbridge.bus.simulated.traffic import Traffic
from hilbridge.bus.simulated.watch import READ, WRITE
from hilbridge.priority import Level, use_realtime_scheduling

NS_PER_S = 1_000_000_000
DEFAULT_LINGER_S = 1.0  # a bus on which nobody is left is gone within two seconds
_FIRST_CLIENT_WAIT_S = 30.0
_RECORDS_PER_READ = 4
_SPENDER_NS = 500_000  # of work between two sweeps: from then on a client is read a record at a time
_DISPATCH_WORK_NS = 200_000  # in one turn, for frames that come: from then on the bus waits for the next turn
_STRANGERS_PER_TURN = 4
_TURN_S = 0.1
_READ_WORK_NS = 250_000  # in one turn: who has just come waits for no more than that, and for
_BUS_WORK_NS = 500_000  # so much of the bus's catching up
_NO_REST_NS = 2_000_000
_REST_NS = 200_000
_SWEEP_NS = 50_000_000
_SHARE_NS = 3_000_000  # of work for one client, while the bus cannot keep up; half of it is forgiven at each sweep
_MADE_GOOD_WITHIN_NS = 2_000_000  # of work: what every queue holds after a stall takes less
_OVERLOAD_NS = 5_000_000_000  # from then on nothing is made good, and the bus moves on by a frame or two a turn
_OVERLOAD_STEP_NS = 200_000
_PR_SET_TIMERSLACK = 29
_WAKE_EARLY_NS = 60_000
_CLOSING_LIMIT_NS = 100_000_000  # a client that has gone may still send what it had queued, but not for ever


class BusServer:
    """Serves one bus on an already listening socket. `clock` is the monotonic clock in ns."""

    def __init__(
        self,
        name: str,
        listener: socket.socket,
        medium: Medium,
        *,
        linger_s: float | None = DEFAULT_LINGER_S,
        orphaned: Callable[[], bool] = lambda: False,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """`orphaned`: whether the process that has started this one is gone; asked while nobody is attached."""
        self.name = name
        self.medium = medium
        self._clock = clock
        self._linger_ns = None if linger_s is None else int(linger_s * NS_PER_S)
        self._idle_until_ns = clock() + int(max(linger_s or 0, _FIRST_CLIENT_WAIT_S) * NS_PER_S)
        self._reception = Reception(name, listener, medium, clock)
        self._by_node = self._reception.by_node
        self._traffic = Traffic(medium, self._by_node)
        self._orphaned = orphaned
        self._stopped = False
        self._reached_ns = 0  # of the bus's own time
        self._behind_since_ns: int | None = None
        self._overloaded_until_ns = 0
        self._sweep_ns = 0
        self._resume_ns = 0
        self._rested_ns = 0
        self._bus_work_ns = 0
        self._turn_bus_ns = 0
        self._is_pressed = False  # the bus cannot keep up: in this turn it moves no more, and clients are read briefly

    def stop(self) -> None:
        """Leave `run` at its next turn (from another thread: at most a tenth of a second later)."""
        self._stopped = True

    def run(self) -> None:
        """Serve until stopped, or until nobody has been attached for the linger time."""
        try:
            while not self._stopped:
                now_ns = self._clock()
                if not self._by_node and self._linger_ns is not None and self._unwanted(now_ns):
                    return
                if now_ns >= self._resume_ns:
                    self._catch_up(now_ns)
                self._drop_closed(now_ns)
                if now_ns >= self._sweep_ns:
                    self._sweep(now_ns)
                self._serve_ready(self._wait())
        finally:
            self._reception.close()

    def _unwanted(self, now_ns: int) -> bool:
        """Nobody came for long, or whoever this was started for has died before it could come."""
        if now_ns > self._idle_until_ns:
            return True
        soon_ns = now_ns + (self._linger_ns or 0)
        if self._idle_until_ns > soon_ns and self._orphaned():
            self._idle_until_ns = soon_ns
        return False

    def _pause_s(self) -> float:
        # A sleep ends late by some ten microseconds, a frame lasts a quarter millisecond: wake early, then look often.
        if self._behind_since_ns is not None:
            return 0.0
        left_ns = self.medium.due_ns + self._traffic.slip_ns - self._clock() - _WAKE_EARLY_NS
        return min(_TURN_S, max(0, left_ns) / NS_PER_S)

    def _wait(self) -> list[tuple[socket.socket, int, Client | None]]:
        """Until somebody wants something or the bus moves. A flood does not keep this process from all rest: the kernel
        would stop one in real time for a twentieth of every second, in one piece."""
        began_ns = self._clock()
        ready = self._reception.watch.wait(self._pause_s())
        now_ns = self._clock()
        if now_ns - began_ns >= _REST_NS:
            self._rested_ns = now_ns
        elif now_ns - self._rested_ns > _NO_REST_NS:
            time.sleep(_REST_NS / NS_PER_S)
            self._rested_ns = self._clock()
        return ready

    def _sweep(self, now_ns: int) -> None:
        """Expire, and forgive each client half of its cost: who floods comes after who does not, also at once after."""
        self._sweep_ns = now_ns + _SWEEP_NS
        self._reception.expire(now_ns)
        for client in self._by_node.values():
            client.spent_ns //= 2

    # Clients

    def _serve_ready(self, ready: list[tuple[socket.socket, int, Client | None]]) -> None:
        """Whoever has cost least comes first, and a turn is short: a flood delays nobody but itself."""
        known = [
            (client, stream)
            for stream, events, client in ready
            if client is not None and self._flushed(client, stream, events)
        ]
        known.sort(key=lambda entry: (entry[0].spent_ns, entry[0].served_ns))
        began_ns = at_ns = self._clock()
        served = 0
        self._bus_work_ns = self._turn_bus_ns = 0
        self._is_pressed = self._behind_since_ns is not None or began_ns < self._overloaded_until_ns
        for client, stream in known:
            if client.spent_ns > _SHARE_NS and began_ns < self._overloaded_until_ns:
                break  # they and the rest have had their share, and wait for the next sweep
            if client.closing_ns is None:
                self._read_client(stream, client)
            served += 1
            before_ns, at_ns = at_ns, self._clock()
            client.served_ns = at_ns
            client.spent_ns += at_ns - before_ns - self._bus_work_ns  # what the bus had to do meanwhile is nobody's
            self._bus_work_ns = 0
            if at_ns - began_ns > _READ_WORK_NS:
                break
        if known and not served:
            time.sleep(_REST_NS / NS_PER_S)
        reception = self._reception
        strangers = [stream for stream, _, client in ready if client is None]
        for stream in strangers[:_STRANGERS_PER_TURN]:
            if stream is reception.listener:
                reception.accept()
            elif stream in reception.strangers:
                reception.shake_hands(stream)

    def _flushed(self, client: Client, stream: socket.socket, events: int) -> bool:
        """Send what has waited for room; gives whether there is something to read as well."""
        if events & WRITE:
            box = client.deliveries if stream is client.receive else client.credits
            if box is not None and client.closing_ns is None:
                box.flush()
        return bool(events & READ)

    def _read_client(self, stream: socket.socket, client: Client) -> None:
        if client.deaf and stream is client.receive:
            return
        if stream is client.receive or client.reader is None:  # nothing is ever sent on it: this is its end
            self._reception.stop_delivering(client)
            return
        try:
            is_brief = self._is_pressed or client.spent_ns > _SPENDER_NS
            for record in client.reader.read_some(1 if is_brief else _RECORDS_PER_READ):
                self._on_record(client, record)
        except OSError:
            self._reception.leave(client)
            return
        if self._reception.overfull(client):
            self._reception.dismiss(client, "answers left unread")

    def _on_record(self, client: Client, record: Record) -> None:
        now_ns = self._clock()
        if record.kind == Kind.FRAME:
            self._dispatch(now_ns)
            result = self.medium.send(client.node, record_frame(record), record.sequence, self._bus_now_ns(now_ns))
            if result is not Enqueued.QUEUED:
                self._reception.refused[result] += 1
                self._traffic.credit(client.node, record.sequence, result)
            self._dispatch(now_ns)
        elif record.kind == Kind.CONTROL:
            if len(client.request) > REQUEST_LIMIT_BYTES:  # its end is still awaited, its content no more
                client.request = client.request[: REQUEST_LIMIT_BYTES + 1]
            client.request += record.data
            if record.extra == 0:  # the last part
                request, client.request = client.request, b""
                self._dispatch(now_ns)
                self._answer(client, request, now_ns)
        else:
            self._reception.refused["records of no meaning"] += 1

    def _answer(self, client: Client, request: bytes, now_ns: int) -> None:
        given = answer(self.medium, client.node, request, self._bus_now_ns(now_ns))
        if "error" in given:
            self._reception.refused["requests"] += 1
        if "nodes" in given:
            given |= {"now_ns": now_ns, "slip_ns": self._traffic.slip_ns, "refused": dict(self._reception.refused)}
        if client.credits is not None:
            client.credits.push(in_parts(Kind.ANSWER, json.dumps(given).encode()), keep=True)

    # The bus

    def _dispatch(self, now_ns: int) -> None:
        """Let the bus catch up before and after a frame; once it is behind, only once a turn."""
        if not self._is_pressed and self._behind_since_ns is None and self._turn_bus_ns < _DISPATCH_WORK_NS:
            began_ns = self._clock()
            self._catch_up(now_ns)
            spent_ns = self._clock() - began_ns
            self._turn_bus_ns += spent_ns
            self._bus_work_ns += spent_ns

    def _bus_now_ns(self, now_ns: int) -> int:
        """The present on the bus: the clock's, unless the bus cannot keep up with it."""
        if now_ns < self._overloaded_until_ns:
            due_ns = max(self._reached_ns, self.medium.due_ns)  # an idle bus is late for nothing
            slip_ns = now_ns - due_ns - _OVERLOAD_STEP_NS
            if slip_ns > self._traffic.slip_ns:
                self._traffic.slip_ns = slip_ns
                self.medium.hasten(now_ns - slip_ns)
        return now_ns - self._traffic.slip_ns

    def _catch_up(self, now_ns: int) -> None:
        """Let the bus catch up with the clock, for a turn's worth of work at most.

        A stall is made good. But faults and crowds can ask for more than this computer can carry out in time: then the
        bus's own time slips, so that whoever has something urgent does not wait for what is left undone.
        """
        target_ns = self._bus_now_ns(now_ns)
        began_ns = self._clock()
        while True:
            self._reached_ns, events = self.medium.advance_to_event(target_ns)
            for event in events:
                self._traffic.carry(event)
            if self._reached_ns >= target_ns and self.medium.due_ns > target_ns:
                self._behind_since_ns = None
                return
            at_ns = self._clock()
            if at_ns - began_ns > _BUS_WORK_NS:
                break
        if self._behind_since_ns is None:
            self._behind_since_ns = at_ns
        if at_ns - self._behind_since_ns > _MADE_GOOD_WITHIN_NS or at_ns < self._overloaded_until_ns:
            self._overloaded_until_ns = at_ns + _OVERLOAD_NS
            if at_ns - began_ns > 2 * _BUS_WORK_NS:  # one step alone may take as long; then clients have as long
                self._resume_ns = 2 * at_ns - began_ns

    def _drop_closed(self, now_ns: int) -> None:
        for node, client in list(self._by_node.items()):
            if client.closing_ns is None:
                continue
            if self.medium.queued(node) == 0 or now_ns - client.closing_ns > _CLOSING_LIMIT_NS:
                self._reception.forget_node(client)
                if self._linger_ns is not None:
                    self._idle_until_ns = now_ns + self._linger_ns


def serve(
    name: str,
    *,
    bitrate: int = 500_000,
    data_bitrate: int = 2_000_000,
    linger_s: float | None = None,
    ready: Callable[[], None] | None = None,
    orphaned: Callable[[], bool] = lambda: False,
) -> None:
    """Serve the simulated bus `name` in this thread until nobody has been attached for `linger_s` (None: for ever).

    `ready` is called once clients can attach. Raises BusNameTaken (an OSError) where another process serves it.
    """
    server = BusServer(name, claim(name), Medium(bitrate, data_bitrate), linger_s=linger_s, orphaned=orphaned)
    if ready is not None:
        ready()
    server.run()


def _wake_promptly() -> None:
    """Run before the bus's clients, and let sleeps end within a microsecond, not fifty: a frame lasts 0.25 ms."""
    use_realtime_scheduling(Level.BUS)
    if sys.platform != "linux":
        return
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1_000, 0, 0, 0)


def main(arguments: list[str] | None = None) -> int:
    """Command line of the detached server process. Exit status 0 also when another process was faster."""
    parser = argparse.ArgumentParser(prog="python -m hilbridge.bus.simulated.server", description=__doc__)
    parser.add_argument("name")
    parser.add_argument("--bitrate", type=int, default=500_000)
    parser.add_argument("--data-bitrate", type=int, default=2_000_000)
    parser.add_argument("--linger", type=float, default=DEFAULT_LINGER_S, help="seconds to stay without a client")
    parser.add_argument("--starter", type=int, help="process that this is started for")
    options = parser.parse_args(arguments)
    _wake_promptly()
    try:
        serve(
            options.name,
            bitrate=options.bitrate,
            data_bitrate=options.data_bitrate,
            linger_s=options.linger,
            orphaned=lambda: options.starter is not None and os.getppid() != options.starter,
            ready=lambda: print("serving", options.name, flush=True),  # noqa: T201 - whoever started it may wait for this
        )
    except BusNameTaken:
        return 0
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
