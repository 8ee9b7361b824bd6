"""A client's two connections to a simulated bus, without python-can: attach (starting it if need be), send, receive."""

from __future__ import annotations

import json
import os
import select
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import hilbridge
from hilbridge.bus.model.error_frames import ErrorState
from hilbridge.bus.model.events import Enqueued
from hilbridge.bus.model.frames import WireFrame, frame_fault
from hilbridge.bus.simulated.protocol import (
    HOST,
    LINK_VERSION,
    Arrival,
    Flag,
    Kind,
    Record,
    RecordReader,
    arrival_of,
    frame_record,
    in_parts,
    open_stream,
    ports_of,
    read_within,
)

_HANDSHAKE_S = 2.0
_CLOSE_S = 0.5
_START_S = 15.0  # a first Python start on a loaded machine
_NAME_LIMIT_BYTES = 64
# Servers this process started: kept so that a finished one is reaped and none is reported as forgotten.
_started: list[subprocess.Popen[bytes]] = []


class BusNotReachable(ConnectionError):
    """There is no simulated bus of this name and none could be started; the message says what to do."""


class Rates(NamedTuple):
    """Bit rates of a bus in bit/s: of arbitration, and of the data of FD frames that switch."""

    bitrate: int = 500_000
    data_bitrate: int = 2_000_000


_USUAL_RATES = Rates()


class BusClient:
    """One node of a simulated bus. Not thread safe for two senders or two receivers at once."""

    def __init__(
        self,
        name: str,
        *,
        listen_only: bool = False,
        receive_own: bool = False,
        bus_errors: bool = False,
        node: str = "",
        rates: Rates = _USUAL_RATES,
        start: bool = True,
    ) -> None:
        """Attach to the bus called `name` as the node called `node`; `start` starts it where there is none.

        `rates` hold where this starts the bus. `bus_errors` asks for an error frame per failed attempt, not only
        for changes of the controller's state.
        Raises BusNotReachable, or ValueError for a name that is empty or longer than 64 bytes.
        """
        if not name or len(name.encode()) > _NAME_LIMIT_BYTES:
            raise ValueError(f"a simulated bus's name has 1..{_NAME_LIMIT_BYTES} bytes, not {name!r}")
        self.name = name
        self.in_flight = 0
        self.refused = 0
        self._sequence = 0
        self.state = ErrorState.ACTIVE
        self.tx_errors = self.rx_errors = 0
        self._node_name = node or f"pid {os.getpid()}"
        self._answer = b""
        self._listen_only = listen_only
        flags = (
            (Flag.LISTEN_ONLY if listen_only else 0)
            | (Flag.RECEIVE_OWN if receive_own else 0)
            | (Flag.BUS_ERRORS if bus_errors else 0)
        )
        self._connect(int(flags), start, rates)
        self._reader = RecordReader(self._receive)
        self._credits = RecordReader(self._transmit)
        self._receive.setblocking(False)
        self._transmit.setblocking(False)

    def _connect(self, flags: int, start: bool, rates: Rates) -> None:
        deadline_s = time.monotonic() + _START_S
        process = None
        while not self._try_ports(flags):
            if not start:
                raise BusNotReachable(f"no simulated bus called {self.name!r} is running")
            if process is None:
                process = _start_server(self.name, *rates)
            elif process.poll() not in (None, 0):
                raise BusNotReachable(
                    f"the simulated bus {self.name!r} could not be started; "
                    f"`python -m hilbridge.bus.simulated.server {self.name}` says why"
                )
            if time.monotonic() > deadline_s:
                raise BusNotReachable(f"the simulated bus {self.name!r} did not come up in {_START_S:.0f} s")
            time.sleep(0.02)

    def _try_ports(self, flags: int) -> bool:
        for port in ports_of(self.name):
            try:
                if self._try_port(port, flags):
                    return True
            except BusNotReachable:
                raise
            except OSError:
                continue
        return False

    def _try_port(self, port: int, flags: int) -> bool:
        receive = open_stream((HOST, port), _HANDSHAKE_S)
        try:
            receive.sendall(
                Record(Kind.HELLO, flags, LINK_VERSION, sequence=os.getpid(), data=self.name.encode()).pack()
            )
            welcome = read_within(receive, _HANDSHAKE_S)
            if welcome.kind != Kind.WELCOME:
                receive.close()
                if welcome.kind == Kind.FULL:
                    raise BusNotReachable(
                        f"the simulated bus {self.name!r} has all the clients that it takes; close some"
                    )
                return False
            transmit = open_stream((HOST, port), _HANDSHAKE_S)
        except OSError:
            receive.close()
            raise
        try:
            transmit.sendall(
                Record(
                    Kind.HELLO,
                    Flag.TRANSMIT_SIDE,
                    LINK_VERSION,
                    stamp_ns=welcome.stamp_ns,
                    sequence=welcome.sequence,
                    data=self._node_name.encode()[:_NAME_LIMIT_BYTES],
                ).pack()
            )
            read_within(transmit, _HANDSHAKE_S)
        except OSError:
            receive.close()
            transmit.close()
            raise
        self._receive, self._transmit = receive, transmit
        self.node = welcome.sequence
        self.queue_limit = welcome.dropped
        rates = welcome.data.decode().split()
        self.bitrate, self.data_bitrate = int(rates[0]), int(rates[1])
        return True

    def fileno(self) -> int:
        """Readable exactly while a frame waits (or the bus has gone)."""
        return self._receive.fileno()

    def receive(self) -> Arrival | None:
        """One frame, or None when none waits. Raises OSError when the bus has gone."""
        record = self._reader.read()
        return None if record is None else arrival_of(record)

    def wait_readable(self, timeout_s: float | None) -> bool:
        """Wait for a frame."""
        return bool(select.select([self._receive], [], [], timeout_s)[0])

    def send(self, frame: WireFrame, timeout_s: float = 0.0) -> Enqueued:
        """Queue a frame; never waits longer than `timeout_s` for room. Raises OSError when the bus has gone."""
        if self._listen_only:
            return Enqueued.LISTEN_ONLY
        if frame_fault(frame) is not None:
            return Enqueued.BAD_FRAME
        if 2 * self.in_flight >= self.queue_limit:
            self._collect_credits()
        deadline_s = time.monotonic() + timeout_s if timeout_s > 0 else 0.0
        if self.state is ErrorState.BUS_OFF:
            self._collect_credits()
            if self.state is ErrorState.BUS_OFF:
                return Enqueued.BUS_OFF
        while self.in_flight >= self.queue_limit:
            left_s = deadline_s - time.monotonic() if timeout_s > 0 else 0.0
            if left_s <= 0 or not select.select([self._transmit], [], [], left_s)[0]:
                return Enqueued.FULL
            self._collect_credits()
        self._sequence = (self._sequence + 1) & 0xFFFF_FFFF
        raw = frame_record(frame, 0, self._sequence, 0).pack()
        try:
            sent = self._transmit.send(raw)
        except (BlockingIOError, InterruptedError):
            return Enqueued.FULL
        self._send_whole(raw[sent:])  # never leave half a record on the stream
        self.in_flight += 1
        return Enqueued.QUEUED

    def _collect_credits(self) -> None:
        while (record := self._credits.read()) is not None:
            self._on_credit(record)

    def _on_credit(self, record: Record) -> None:
        if record.kind == Kind.SENT:
            self.in_flight -= 1
            self.refused += bool(record.data)
        elif record.kind == Kind.STATE:
            self.state = ErrorState(record.data.decode())
            self.tx_errors, self.rx_errors = record.sequence, record.dropped
        elif record.kind == Kind.ANSWER:
            self._answer += record.data

    def refresh(self) -> None:
        """Read the news of this node's controller (`state`, `tx_errors`, `rx_errors`, `refused`)."""
        self._collect_credits()

    def recover(self) -> None:
        """Leave bus-off after 128 sequences of eleven recessive bits, where that does not happen by itself."""
        self.control({"op": "recover"})

    def control(self, request: dict[str, Any], timeout_s: float = 2.0) -> dict[str, Any]:
        """Ask the bus something (`control` has the requests). Raises OSError, TimeoutError among them."""
        self._answer = b""
        self._send_whole(in_parts(Kind.CONTROL, json.dumps(request).encode()))
        deadline_s = time.monotonic() + timeout_s
        while select.select([self._transmit], [], [], max(0.0, deadline_s - time.monotonic()))[0]:
            while (record := self._credits.read()) is not None:
                self._on_credit(record)
                if record.kind == Kind.ANSWER and record.extra == 0:
                    answer: dict[str, Any] = json.loads(self._answer)
                    return answer
        raise TimeoutError(f"the simulated bus {self.name!r} did not answer within {timeout_s} s")

    def _send_whole(self, raw: bytes) -> None:
        while raw:
            select.select([], [self._transmit], [])
            raw = raw[self._transmit.send(raw) :]

    def close(self) -> None:
        """Leave the bus. What was queued is still sent: the bus is given a moment to read it all."""
        self._receive.close()
        try:
            self._transmit.shutdown(socket.SHUT_WR)
            # Closing with credits unread would reset the connection, and frames on their way would be lost with it.
            self._transmit.settimeout(_CLOSE_S)
            while self._transmit.recv(4096):
                pass
        except OSError:
            pass
        self._transmit.close()


def _start_server(name: str, bitrate: int, data_bitrate: int) -> subprocess.Popen[bytes]:
    """Start the bus as a process of its own, outliving this one and out of reach of its terminal's signals."""
    environment = dict(os.environ)
    root = str(Path(hilbridge.__file__).resolve().parent.parent)
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, [root, environment.get("PYTHONPATH")]))
    command = [sys.executable, "-m", "hilbridge.bus.simulated.server", name]
    command += ["--bitrate", str(bitrate), "--data-bitrate", str(data_bitrate)]
    command += ["--starter", str(os.getpid())]
    process = subprocess.Popen(
        command,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    _started.append(process)
    return process
