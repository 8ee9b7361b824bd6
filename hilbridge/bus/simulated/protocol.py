"""What a simulated bus and its clients say to each other over the loopback: fixed-size records, and how they meet.

A bus is a process that listens on a loopback TCP port derived from the bus's name. The listening socket itself is the
lock and the rendezvous: no file is left behind when a process dies, and binding it is atomic on every system. Another
program or another bus may hold the port, so several candidates are tried and the handshake tells the name.

Each client has two connections: on `receive` only frames arrive, one record each, so that its descriptor is readable
exactly while frames wait (what a selector, `can.Notifier` and asyncio need); on `transmit` frames go out and credits,
states and answers come back.
"""

from __future__ import annotations

import socket
import struct
import sys
import zlib
from collections import deque
from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple

from hilbridge.bus.model.frames import WireFrame

LINK_VERSION = 1
HOST = "127.0.0.1"
_FIRST_PORT, _PORT_SPAN, PORT_CANDIDATES = 20_000, 11_000, 8

# A bus that has only just begun, on a machine under load, answers late; giving up on it would make a second of that name.
_ANSWER_S = 10.0

DATA_BYTES = 64
_RECORD = struct.Struct("<BBBBIqII64s")
RECORD_BYTES = _RECORD.size


class Kind(IntEnum):
    """What a record is."""

    HELLO = 1
    WELCOME = 2
    REFUSED = 3
    FRAME = 4
    SENT = 5
    STATE = 6
    CONTROL = 7
    ANSWER = 8
    FULL = 9


class Flag:
    """Flags of FRAME and HELLO records: plain numbers, they are looked at for every frame."""

    EXTENDED = 1
    FD = 2
    SWITCH = 4
    ERROR_STATE = 8
    REMOTE = 16
    ERROR = 32
    OWN = 64
    # HELLO
    LISTEN_ONLY = 1
    RECEIVE_OWN = 2
    TRANSMIT_SIDE = 4
    BUS_ERRORS = 8  # every failed attempt as an error frame, not only changes of state


class Arrival(NamedTuple):
    """A received frame: `dropped` counts all frames this reader has lost before it by being slow.

    An error frame (`error`) has Linux's error classes as `frame.can_id` (see `error_frames`).
    """

    frame: WireFrame
    stamp_ns: int
    own: bool = False
    error: bool = False
    dropped: int = 0


class Record(NamedTuple):
    """One message. `sequence` numbers a client's frames (or is its node), `dropped` counts frames its reader lost."""

    kind: int
    flags: int = 0
    extra: int = 0
    can_id: int = 0
    stamp_ns: int = 0
    sequence: int = 0
    dropped: int = 0
    data: bytes = b""

    def pack(self) -> bytes:
        """The record as RECORD_BYTES bytes."""
        return _RECORD.pack(
            self.kind,
            self.flags,
            len(self.data),
            self.extra,
            self.can_id,
            self.stamp_ns,
            self.sequence,
            self.dropped,
            self.data,
        )


def unpack(raw: bytes) -> Record:
    """Read one record of RECORD_BYTES bytes."""
    kind, flags, length, extra, can_id, stamp_ns, sequence, dropped, data = _RECORD.unpack(raw)
    return Record(kind, flags, extra, can_id, stamp_ns, sequence, dropped, data[:length])


def frame_record(frame: WireFrame, stamp_ns: int, sequence: int, dropped: int, flags: int = 0) -> Record:
    """A frame as a record."""
    flags |= (
        frame.is_extended
        | frame.is_fd << 1
        | frame.bit_rate_switch << 2
        | frame.error_state_indicator << 3
        | frame.is_remote << 4
    )
    return Record(Kind.FRAME, flags, frame.remote_length, frame.can_id, stamp_ns, sequence, dropped, frame.data)


def record_frame(record: Record) -> WireFrame:
    """The frame in a FRAME record."""
    flags = record.flags
    return WireFrame(
        record.can_id,
        record.data,
        bool(flags & Flag.EXTENDED),
        bool(flags & Flag.FD),
        bool(flags & Flag.SWITCH),
        bool(flags & Flag.ERROR_STATE),
        bool(flags & Flag.REMOTE),
        record.extra,
    )


def in_parts(kind: Kind, raw: bytes) -> bytes:
    """As many records as `raw` needs; `extra` is 1 where another part follows."""
    pack, kept = _RECORD.pack, []  # a status of many nodes is some hundred records: no Record is made of each
    for start in range(0, max(1, len(raw)), DATA_BYTES):
        part = raw[start : start + DATA_BYTES]
        kept.append(pack(kind, 0, len(part), start + DATA_BYTES < len(raw), 0, 0, 0, 0, part))
    return b"".join(kept)


def arrival_of(record: Record) -> Arrival:
    """A FRAME record as its receiver sees it."""
    flags = record.flags
    own, error = bool(flags & Flag.OWN), bool(flags & Flag.ERROR)
    return Arrival(record_frame(record), record.stamp_ns, own, error, record.dropped)


def ports_of(name: str) -> list[int]:
    """The loopback ports on which the bus called `name` may be found, in the order to try."""
    return [_FIRST_PORT + zlib.crc32(f"{attempt}:{name}".encode()) % _PORT_SPAN for attempt in range(PORT_CANDIDATES)]


def listen_exclusively(port: int) -> socket.socket:
    """A listening loopback socket that no second process can share. Raises OSError where the port is taken."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        if sys.platform == "win32":
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
        else:  # only lets a port be taken again at once after its owner has gone
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((HOST, port))
        listener.listen(64)
    except OSError:
        listener.close()
        raise
    return listener


class RecordReader:
    """Whole records out of a stream socket, never more than asked for, so that what is left stays in the kernel."""

    def __init__(self, stream: socket.socket) -> None:
        self._stream = stream
        self._partial = b""

    def read(self) -> Record | None:
        """One record, or None when there is none yet. Raises ConnectionResetError at the end of the stream."""
        try:
            raw = self._stream.recv(RECORD_BYTES - len(self._partial))
        except (BlockingIOError, InterruptedError):
            return None
        if not raw:
            raise ConnectionResetError("the simulated bus has gone")
        raw = self._partial + raw
        if len(raw) < RECORD_BYTES:
            self._partial = raw
            return None
        self._partial = b""
        return unpack(raw)

    def read_some(self, limit: int) -> list[Record]:
        """At most `limit` records with one call to the kernel. Raises ConnectionResetError at the end of the stream."""
        try:
            raw = self._stream.recv(limit * RECORD_BYTES - len(self._partial))
        except (BlockingIOError, InterruptedError):
            return []
        if not raw:
            raise ConnectionResetError("the client has gone")
        raw = self._partial + raw
        whole = len(raw) // RECORD_BYTES * RECORD_BYTES
        self._partial = raw[whole:]
        return [unpack(raw[start : start + RECORD_BYTES]) for start in range(0, whole, RECORD_BYTES)]


def open_stream(address: tuple[str, int], timeout_s: float) -> socket.socket:
    """Connect without Nagle's delay. Raises OSError."""
    stream = socket.create_connection(address, timeout=timeout_s)
    stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return stream


def read_within(stream: socket.socket, timeout_s: float) -> Record:
    """One record, waiting at most `timeout_s` for each part of it. Raises OSError (TimeoutError among them)."""
    stream.settimeout(timeout_s)
    raw = b""
    while len(raw) < RECORD_BYTES:
        part = stream.recv(RECORD_BYTES - len(raw))
        if not part:
            raise ConnectionResetError("the other side closed the connection")
        raw += part
    return unpack(raw)


class RecordWriter:
    """A non-blocking stream of records. What does not fit is dropped and counted, like a full socket receive queue."""

    def __init__(self, stream: socket.socket, on_block: Callable[[bool], None] = lambda blocked: None) -> None:
        """`on_block` is told when records begin to wait for their reader (True) and when none does any more."""
        self.stream = stream
        self.dropped = 0
        self.kept_bytes = 0
        self._kept: deque[bytes] = deque()
        self._on_block = on_block

    def push(self, raw: bytes, *, keep: bool = False) -> bool:
        """Send now; gives False where the reader is so slow that the record was dropped (`keep` queues it instead)."""
        if not self._kept:
            try:
                sent = self.stream.send(raw)
            except (BlockingIOError, InterruptedError):
                sent = 0
            except OSError:  # the reader has gone; its end of stream will be seen by the reading side
                return False
            if sent == len(raw):
                return True
            if sent:
                self._keep(raw[sent:])
                return True
        if keep:
            self._keep(raw)
            return True
        self.dropped += 1
        return False

    def _keep(self, raw: bytes) -> None:
        if not self._kept:
            self._on_block(True)
        self._kept.append(raw)
        self.kept_bytes += len(raw)

    def flush(self) -> None:
        """Send what waits, as far as the reader takes it."""
        while self._kept:
            raw = self._kept.popleft()
            try:
                sent = self.stream.send(raw)
            except (BlockingIOError, InterruptedError):
                sent = 0
            except OSError:
                self._kept.clear()
                self.kept_bytes = 0
                break
            self.kept_bytes -= sent
            if sent < len(raw):
                self._kept.appendleft(raw[sent:])
                return
        self._on_block(False)


class BusNameTaken(OSError):
    """A bus of this name is served already."""


def claim(name: str) -> socket.socket:
    """A listening socket for the bus called `name`.

    Raises BusNameTaken where it is served already, OSError where no port is free.
    """
    refused: OSError | None = None
    for port in ports_of(name):
        try:
            return listen_exclusively(port)
        except OSError as error:
            refused = error
            if _serves(port, name):
                raise BusNameTaken(f"the simulated bus {name!r} is served already") from None
    raise OSError(f"no loopback port is free for the simulated bus {name!r}") from refused


def _serves(port: int, name: str) -> bool:
    """Whether the program at `port` is the bus called `name`: it refuses an impossible name by telling its own."""
    try:
        with open_stream((HOST, port), _ANSWER_S) as stream:
            stream.sendall(Record(Kind.HELLO, extra=LINK_VERSION, data=b"\0").pack())
            answer = read_within(stream, _ANSWER_S)
    except OSError:
        return False
    return answer.kind == Kind.REFUSED and answer.data.decode(errors="replace") == name
