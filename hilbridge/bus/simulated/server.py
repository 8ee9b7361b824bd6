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
import select
import socket
import sys
import time
from collections.abc import Callable
from typing import Any

from hilbridge.bus.model.error_frames import write_error_frame
from hilbridge.bus.model.events import BusError, Delivered, Enqueued, Event, FrameLost, StateChanged
from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.model.medium import Medium
from hilbridge.bus.model.nodes import BABBLE_TAG
from hilbridge.bus.simulated.control import answer
from hilbridge.bus.simulated.handshake import Client, Reception
from hilbridge.bus.simulated.protocol import (
    BusNameTaken,
    Flag,
    Kind,
    Record,
    claim,
    frame_record,
    in_parts,
    record_frame,
)
from hilbridge.priority import Level, use_realtime_scheduling

NS_PER_S = 1_000_000_000
DEFAULT_LINGER_S = 1.0  # a bus on which nobody is left is gone within two seconds
_FIRST_CLIENT_WAIT_S = 30.0
_READS_PER_TURN = 64
_TURN_S = 0.1
_PR_SET_TIMERSLACK = 29
_WAKE_EARLY_NS = 60_000
_CLOSING_LIMIT_NS = 100_000_000  # a client that has gone may still send what it had queued, but not for ever
_CONTROL_LIMIT_BYTES = 1 << 16


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
        self._reception = Reception(name, listener, medium)
        self._by_node = self._reception.by_node
        self._orphaned = orphaned
        self._stopped = False

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
                self._dispatch(now_ns)
                self._drop_closed(now_ns)
                self._wait()
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

    def _wait(self) -> None:
        # A sleep ends late by some ten microseconds, a frame lasts a quarter millisecond: wake early, then look often.
        left_ns = self.medium.due_ns - self._clock() - _WAKE_EARLY_NS
        timeout_s = min(_TURN_S, max(0, left_ns) / NS_PER_S)
        writers = [
            box.stream
            for client in self._by_node.values()
            for box in (client.deliveries, client.credits)
            if box is not None and box.kept and not client.deaf
        ]
        reception = self._reception
        readers = [reception.listener, *reception.pending, *reception.by_socket]
        readable, writable, _ = select.select(readers, writers, [], timeout_s)
        for stream in writable:
            client = reception.by_socket.get(stream)
            if client is not None:
                box = client.deliveries if stream is client.receive else client.credits
                if box is not None:
                    box.flush()
        for stream in readable:
            self._read(stream)

    def _read(self, stream: socket.socket) -> None:
        reception = self._reception
        if stream is reception.listener:
            reception.accept()
        elif stream in reception.pending:
            reception.shake_hands(stream)
        elif stream in reception.by_socket:
            self._read_client(stream, reception.by_socket[stream])

    def _read_client(self, stream: socket.socket, client: Client) -> None:
        if stream is client.receive or client.reader is None:  # nothing is ever sent on it: this is its end
            self._reception.stop_delivering(client, self._clock())
            return
        try:
            for _ in range(_READS_PER_TURN):
                record = client.reader.read()
                if record is None:
                    return
                self._on_record(client, record)
        except OSError:
            self._reception.leave(client, self._clock())

    def _on_record(self, client: Client, record: Record) -> None:
        now_ns = self._clock()
        if record.kind == Kind.FRAME:
            self._dispatch(now_ns)
            result = self.medium.send(client.node, record_frame(record), record.sequence, now_ns)
            if result is not Enqueued.QUEUED:
                self._credit(client.node, record.sequence, result)
            self._dispatch(now_ns)
        elif record.kind == Kind.CONTROL:
            client.control = (client.control + record.data)[:_CONTROL_LIMIT_BYTES]
            if record.extra == 0:  # the last part
                request, client.control = client.control, b""
                self._dispatch(now_ns)
                self._answer(client, answer(self.medium, client.node, request, now_ns))

    def _answer(self, client: Client, given: dict[str, Any]) -> None:
        raw = json.dumps(given).encode()
        if client.credits is not None:
            client.credits.push(in_parts(Kind.ANSWER, raw), keep=True)

    def _credit(self, number: int, sequence: int, result: Enqueued) -> None:
        """Tell a sender that one of its frames has left its transmit queue, and why if not onto the wire."""
        client = self._by_node.get(number)
        if client is None or client.credits is None or client.deaf or sequence == BABBLE_TAG:
            return
        reason = b"" if result is Enqueued.QUEUED else result.encode()
        client.credits.push(Record(Kind.SENT, sequence=sequence, data=reason).pack(), keep=True)

    def _dispatch(self, now_ns: int) -> None:
        for event in self.medium.advance(now_ns):
            self._on_event(event)

    def _on_event(self, event: Event) -> None:
        match event:
            case Delivered():
                self._on_delivered(event)
            case FrameLost():
                self._credit(event.node, event.tag, event.reason)
            case StateChanged():
                self._on_state(event)
            case BusError():
                self._on_error(event)

    def _on_state(self, event: StateChanged) -> None:
        client = self._by_node.get(event.node)
        if client is None or client.deaf:
            return
        classes, data = write_error_frame(event.state, event.tec, event.rec)
        self._error_frame(client, event.at_ns, classes, data)
        if client.credits is not None:
            state = Record(Kind.STATE, sequence=event.tec, dropped=event.rec, data=event.state.encode())
            client.credits.push(state.pack())

    def _on_error(self, event: BusError) -> None:
        for number, kind in event.errors.items():
            client = self._by_node.get(number)
            if client is None or client.deaf or not client.flags & Flag.BUS_ERRORS:
                continue
            node = self.medium.node(number)
            classes, data = write_error_frame(
                None, node.confinement.tec, node.confinement.rec, kind=kind, sending=number == event.sender
            )
            self._error_frame(client, event.at_ns, classes, data)

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
                packed = frame_record(event.frame, event.at_ns, 0, dropped).pack()
                raw = packed if not dropped else raw
            else:
                packed = raw
            client.deliveries.push(packed)
        sender = self._by_node.get(event.sender)
        if sender is None or sender.deaf or not event.sent:
            return
        if sender.flags & Flag.RECEIVE_OWN:
            own = frame_record(event.frame, event.at_ns, 0, sender.deliveries.dropped, Flag.OWN)
            sender.deliveries.push(own.pack())
        self._credit(event.sender, event.tag, Enqueued.QUEUED)

    def _drop_closed(self, now_ns: int) -> None:
        for node, client in list(self._by_node.items()):
            if client.closing_ns is None:
                continue
            if self.medium.queued(node) == 0 or now_ns - client.closing_ns > _CLOSING_LIMIT_NS:
                self.medium.detach(node)
                del self._by_node[node]
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
