"""Accepts clients of a simulated bus: handshake, then pairs their two connections. All of it within limits."""

from __future__ import annotations

import secrets
import socket
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

from hilbridge.bus.model.medium import Medium
from hilbridge.bus.model.nodes import TX_QUEUE_LIMIT
from hilbridge.bus.simulated.protocol import LINK_VERSION, Flag, Kind, Record, RecordReader, RecordWriter
from hilbridge.bus.simulated.watch import READ, WRITE, Watch

CLIENT_LIMIT = 64  # nodes of one bus; a real segment carries some thirty
STRANGER_LIMIT = 64  # connections that have not said yet what they are
HANDSHAKE_LIMIT_NS = 5_000_000_000
SLOW_LIMIT_NS = 5_000_000_000  # so long may a client leave its answers unread
_ANSWER_LIMIT_BYTES = 1 << 16  # that wait for a client beyond what the kernel keeps for it
_SEND_BUFFER_BYTES = 1 << 17


@dataclass(slots=True, eq=False)
class Client:
    """One attached program: its node of the medium and its connections.

    `deaf`: it no longer receives. `closing_ns`: when it went; what it had queued may still be sent. `blocked_ns`: since
    when it leaves answers unread. `spent_ns`: work it has cost lately. `served_ns`: when it was read last.
    """

    node: int
    cookie: int
    receive: socket.socket
    deliveries: RecordWriter
    flags: int
    joined_ns: int
    transmit: socket.socket | None = None
    credits: RecordWriter | None = None
    reader: RecordReader | None = None
    closing_ns: int | None = None
    blocked_ns: int | None = None
    deaf: bool = False
    spent_ns: int = 0
    served_ns: int = 0
    request: bytes = b""


@dataclass(slots=True, eq=False)
class Stranger:
    """A connection whose handshake is still to come."""

    reader: RecordReader
    since_ns: int


class Reception:
    """Lets clients in and keeps the list of them. `refused` counts who and what was turned away, by reason."""

    def __init__(self, name: str, listener: socket.socket, medium: Medium, clock: Callable[[], int]) -> None:
        self.listener = listener
        self.watch = Watch()
        self.strangers: dict[socket.socket, Stranger] = {}  # the oldest first
        self.by_node: dict[int, Client] = {}
        self.refused: Counter[str] = Counter()
        self._name = name
        self._medium = medium
        self._clock = clock
        listener.setblocking(False)
        self.watch.add(listener)

    def accept(self) -> None:
        """Accept one connection and read its first record, which has mostly come with it."""
        try:
            stream, _ = self.listener.accept()
        except BlockingIOError:
            return
        except OSError:  # the peer gave up before it was accepted, or there is no descriptor left
            self._drop_oldest_stranger()
            return
        if len(self.strangers) >= STRANGER_LIMIT:
            self._drop_oldest_stranger()
        stream.setblocking(False)
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.strangers[stream] = Stranger(RecordReader(stream), self._clock())
        self.watch.add(stream)
        self.shake_hands(stream)

    def _drop_oldest_stranger(self) -> None:
        oldest = next(iter(self.strangers), None)
        if oldest is not None:
            self._forget(oldest, "handshakes too many")

    def _forget(self, stream: socket.socket, reason: str) -> None:
        del self.strangers[stream]
        self.refused[reason] += 1
        self._close(stream)

    def _close(self, stream: socket.socket) -> None:
        self.watch.remove(stream)
        stream.close()

    def shake_hands(self, stream: socket.socket) -> None:
        """Read the first record of an accepted connection: join, pair with the receiving side, or refuse."""
        try:
            hello = self.strangers[stream].reader.read()
        except OSError:
            self._forget(stream, "left before the handshake")
            return
        if hello is None:
            return
        del self.strangers[stream]
        name = hello.data.decode(errors="replace")
        if hello.kind == Kind.HELLO and hello.flags & Flag.TRANSMIT_SIDE:
            self._join_transmit(stream, hello)
        elif hello.kind != Kind.HELLO or hello.extra != LINK_VERSION or name != self._name:
            self._refuse(stream, Kind.REFUSED, "no client of this bus")
        elif not self._has_room():
            self._refuse(stream, Kind.FULL, "clients too many")
        else:
            self._join(stream, hello)

    def _has_room(self) -> bool:
        """Whether one more may come; a client that has only half arrived makes room, the oldest first."""
        if len(self.by_node) < CLIENT_LIMIT:
            return True
        half = [client for client in self.by_node.values() if client.transmit is None and client.closing_ns is None]
        if not half:
            return False
        oldest = min(half, key=lambda client: client.joined_ns)
        self.dismiss(oldest, "handshakes too many")
        self.forget_node(oldest)
        return True

    def forget_node(self, client: Client) -> None:
        """Take the node of a client that has gone off the bus."""
        self._medium.detach(client.node)
        del self.by_node[client.node]

    def _refuse(self, stream: socket.socket, kind: Kind, reason: str) -> None:
        self.refused[reason] += 1
        RecordWriter(stream).push(Record(kind, extra=LINK_VERSION, data=self._name.encode()).pack())
        self._close(stream)

    def _join(self, stream: socket.socket, hello: Record) -> None:
        listen_only = bool(hello.flags & Flag.LISTEN_ONLY)
        node = self._medium.attach(f"pid {hello.sequence}", listen_only=listen_only)
        stream.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        client = Client(
            node,
            secrets.randbits(62),
            stream,
            RecordWriter(stream, lambda blocked: self._on_block(client, stream, blocked)),
            hello.flags,
            self._clock(),
        )
        self.watch.change(stream, READ, client)
        self.by_node[node] = client
        client.deliveries.push(self._welcome(client), keep=True)

    def _on_block(self, client: Client, stream: socket.socket, blocked: bool) -> None:
        """Wait for room. Who leaves answers unread is not read either, so that nothing piles up on his behalf."""
        answers = stream is client.transmit
        if answers:
            client.blocked_ns = self._clock() if blocked else None
        if blocked:
            self.watch.change(stream, WRITE if answers else READ | WRITE, client)
        else:
            self.watch.change(stream, READ, client)

    def _welcome(self, client: Client) -> bytes:
        rates = f"{self._medium.bitrate} {self._medium.data_bitrate}".encode()
        return Record(Kind.WELCOME, 0, LINK_VERSION, 0, client.cookie, client.node, TX_QUEUE_LIMIT, rates).pack()

    def _join_transmit(self, stream: socket.socket, hello: Record) -> None:
        client = self.by_node.get(hello.sequence)
        if client is None or client.cookie != hello.stamp_ns or client.transmit is not None or client.deaf:
            self._refuse(stream, Kind.REFUSED, "no client of this bus")
            return
        client.transmit, client.reader = stream, RecordReader(stream)
        client.credits = RecordWriter(stream, lambda blocked: self._on_block(client, stream, blocked))
        self.watch.change(stream, READ, client)
        self._medium.rename(client.node, hello.data.decode(errors="replace"))
        client.credits.push(self._welcome(client), keep=True)

    def expire(self, now_ns: int) -> None:
        """Turn away who has taken too long over a handshake, and who does not read what he asked for."""
        for stream, stranger in list(self.strangers.items()):
            if now_ns - stranger.since_ns <= HANDSHAKE_LIMIT_NS:
                break
            self._forget(stream, "handshake too slow")
        for client in list(self.by_node.values()):
            if client.closing_ns is not None:
                continue
            if client.transmit is None and now_ns - client.joined_ns > HANDSHAKE_LIMIT_NS:
                self.dismiss(client, "handshake too slow")
            elif client.blocked_ns is not None and now_ns - client.blocked_ns > SLOW_LIMIT_NS:
                self.dismiss(client, "answers left unread")

    def overfull(self, client: Client) -> bool:
        """Whether more waits for this client than anybody needs."""
        return client.credits is not None and client.credits.kept_bytes > _ANSWER_LIMIT_BYTES

    def dismiss(self, client: Client, reason: str) -> None:
        """Close a client's connections, whatever it thinks of that."""
        self.refused[reason] += 1
        self.leave(client)

    def stop_delivering(self, client: Client) -> None:
        """The receiving side has closed; frames already on the transmitting side still count, up to its own end."""
        self._close(client.receive)
        client.deaf = True
        if client.transmit is None:
            self.leave(client)

    def leave(self, client: Client) -> None:
        """The client has gone; its node stays until what it had queued is sent."""
        self._close(client.receive)
        if client.transmit is not None:
            self._close(client.transmit)
        client.deaf = True
        client.closing_ns = self._clock()

    def close(self) -> None:
        """Close every connection and the listener."""
        for client in self.by_node.values():
            self.leave(client)
        for stream in [*self.strangers, self.listener]:
            self._close(stream)
        self.watch.close()
