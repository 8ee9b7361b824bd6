"""Hostile ways to connect to a simulated bus. Each gives the sockets that it leaves open."""

from __future__ import annotations

import random
import socket
import struct
from collections.abc import Callable
from typing import NamedTuple

from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.simulated.protocol import (
    LINK_VERSION,
    RECORD_BYTES,
    Flag,
    Kind,
    Record,
    frame_record,
    in_parts,
    open_stream,
    read_within,
)

_PATIENCE_S = 5.0


class Target(NamedTuple):
    """The bus under attack."""

    name: str
    address: tuple[str, int]

    def connect(self) -> socket.socket:
        """A connection, and nothing said yet."""
        return open_stream(self.address, _PATIENCE_S)

    def hello(self, **fields: int) -> bytes:
        """What an honest client says first."""
        return Record(Kind.HELLO, **{"extra": LINK_VERSION, **fields}, data=self.name.encode()).pack()

    def attach(self, flags: int = 0) -> tuple[socket.socket, socket.socket]:
        """Both connections of a client. Raises OSError where the bus is full."""
        receive = self.connect()
        receive.sendall(self.hello(flags=flags))
        welcome = read_within(receive, _PATIENCE_S)
        if welcome.kind != Kind.WELCOME:
            receive.close()
            raise ConnectionRefusedError("full")
        transmit = self.connect()
        transmit.sendall(self.pairing(welcome))
        read_within(transmit, _PATIENCE_S)
        return receive, transmit

    def pairing(self, welcome: Record) -> bytes:
        """What the second connection says."""
        fields = {"stamp_ns": welcome.stamp_ns, "sequence": welcome.sequence, "extra": LINK_VERSION}
        return Record(Kind.HELLO, Flag.TRANSMIT_SIDE, **fields, data=b"hostile").pack()


def _reset(stream: socket.socket) -> None:
    stream.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    stream.close()


def _pour(stream: socket.socket, raw: bytes) -> None:
    """As much as the other side takes at once."""
    stream.setblocking(False)
    try:
        stream.sendall(raw)
    except BlockingIOError:
        pass


def come_and_go(target: Target, rng: random.Random) -> list[socket.socket]:
    """Connections that end before a word is said, some with a reset."""
    for _ in range(20):
        stream = target.connect()
        if rng.random() < 0.5:
            _reset(stream)
        else:
            stream.close()
    return []


def crowd(target: Target, rng: random.Random) -> list[socket.socket]:
    """Many that say nothing and stay."""
    return [target.connect() for _ in range(rng.randrange(10, 120))]


def rubbish(target: Target, rng: random.Random) -> list[socket.socket]:
    """Another protocol, another version, another bus, or noise."""
    stream = target.connect()
    said = rng.choice(
        [
            b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n" * 4,
            rng.randbytes(rng.randrange(1, 4000)),
            target.hello(extra=99),
            Record(Kind.HELLO, extra=LINK_VERSION, data=b"another bus").pack(),
            Record(rng.randrange(256), data=target.name.encode()).pack(),
            target.hello(flags=Flag.TRANSMIT_SIDE, sequence=rng.randrange(100), stamp_ns=rng.getrandbits(62)),
        ]
    )
    stream.sendall(said)
    return [stream]


def hesitant(target: Target, rng: random.Random) -> list[socket.socket]:
    """Part of a handshake, in one piece or byte by byte."""
    stream, raw = target.connect(), target.hello()
    for position in range(rng.randrange(1, RECORD_BYTES)):
        stream.sendall(raw[position : position + 1])
    return [stream]


def half(target: Target, rng: random.Random) -> list[socket.socket]:
    """Only the receiving side, many times."""
    streams = [target.connect() for _ in range(rng.randrange(1, 80))]
    for stream in streams:
        stream.sendall(target.hello(flags=rng.randrange(4)))
    return streams


def twice(target: Target, rng: random.Random) -> list[socket.socket]:
    """Two sending sides for one receiving side, and a handshake in the middle of a session."""
    receive = target.connect()
    receive.sendall(target.hello())
    welcome = read_within(receive, _PATIENCE_S)
    streams = [receive, target.connect(), target.connect()]
    for stream in streams[1:]:
        stream.sendall(target.pairing(welcome) * 2)
    return streams


def deaf_flood(target: Target, rng: random.Random) -> list[socket.socket]:
    """Questions without end whose answers nobody reads."""
    receive, transmit = target.attach()
    receive.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    _pour(transmit, in_parts(Kind.CONTROL, b'{"op": "status"}') * 20_000)
    return [receive, transmit]


def endless(target: Target, rng: random.Random) -> list[socket.socket]:
    """A request that never ends."""
    receive, transmit = target.attach()
    _pour(transmit, Record(Kind.CONTROL, extra=1, data=b"[" * 64).pack() * 20_000)
    return [receive, transmit]


def frame_flood(target: Target, rng: random.Random) -> list[socket.socket]:
    """Frames far beyond the transmit queue, the impossible among them; then gone, with or without a goodbye."""
    receive, transmit = target.attach(rng.choice([0, Flag.LISTEN_ONLY, Flag.RECEIVE_OWN | Flag.BUS_ERRORS]))
    frames = [WireFrame(0x100 + rng.randrange(0x900), rng.randbytes(8)) for _ in range(500)]
    _pour(transmit, b"".join(frame_record(frame, 0, 7, 0).pack() for frame in frames))
    if rng.random() < 0.5:
        _reset(transmit)
        _reset(receive)
        return []
    return [receive, transmit]


def cut_short(target: Target, rng: random.Random) -> list[socket.socket]:
    """Gone in the middle of a record, or one side at a time."""
    receive, transmit = target.attach()
    transmit.sendall(Record(Kind.CONTROL, extra=1, data=b"{").pack()[: rng.randrange(1, RECORD_BYTES)])
    if rng.random() < 0.5:
        receive.shutdown(socket.SHUT_WR)
        return [receive, transmit]
    receive.close()
    return [transmit]


def talks_on_the_wrong_side(target: Target, rng: random.Random) -> list[socket.socket]:
    """Frames on the connection on which a client only hears."""
    receive, transmit = target.attach()
    receive.sendall(frame_record(WireFrame(0x100), 0, 1, 0).pack() * 10)
    return [receive, transmit]


PATTERNS: tuple[Callable[[Target, random.Random], list[socket.socket]], ...] = (
    come_and_go,
    crowd,
    rubbish,
    hesitant,
    half,
    twice,
    deaf_flood,
    endless,
    frame_flood,
    cut_short,
    talks_on_the_wrong_side,
)
