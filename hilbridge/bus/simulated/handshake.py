"""Accepts clients of a simulated bus: handshake, then pairs their two connections."""

from __future__ import annotations

import secrets
import socket
from dataclasses import dataclass

from hilbridge.bus.model.medium import Medium
from hilbridge.bus.model.nodes import TX_QUEUE_LIMIT
from hilbridge.bus.simulated.protocol import LINK_VERSION, Flag, Kind, Record, RecordReader, RecordWriter

_SEND_BUFFER_BYTES = 1 << 17


@dataclass(slots=True, eq=False)
class Client:
    """One attached program: its node of the medium and its connections.

    `deaf`: it no longer receives. `closing_ns`: when it went; what it had queued may still be sent.
    """

    node: int
    cookie: int
    receive: socket.socket
    deliveries: RecordWriter
    flags: int
    transmit: socket.socket | None = None
    credits: RecordWriter | None = None
    reader: RecordReader | None = None
    closing_ns: int | None = None
    deaf: bool = False
    control: bytes = b""


class Reception:
    """Lets clients in and keeps the list of them, by node and by socket."""

    def __init__(self, name: str, listener: socket.socket, medium: Medium) -> None:
        self.listener = listener
        self.pending: dict[socket.socket, RecordReader] = {}
        self.by_socket: dict[socket.socket, Client] = {}
        self.by_node: dict[int, Client] = {}
        self._name = name
        self._medium = medium
        listener.setblocking(False)

    def accept(self) -> None:
        """Accept one connection; its handshake is still to come."""
        try:
            stream, _ = self.listener.accept()
        except OSError:  # the peer gave up before it was accepted
            return
        stream.setblocking(False)
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.pending[stream] = RecordReader(stream)

    def shake_hands(self, stream: socket.socket) -> None:
        """Read the first record of an accepted connection: join, pair with the receiving side, or refuse."""
        try:
            hello = self.pending[stream].read()
        except OSError:
            del self.pending[stream]
            stream.close()
            return
        if hello is None:
            return
        del self.pending[stream]
        name = hello.data.decode(errors="replace")
        if hello.kind == Kind.HELLO and hello.flags & Flag.TRANSMIT_SIDE:
            self._join_transmit(stream, hello)
        elif hello.kind != Kind.HELLO or hello.extra != LINK_VERSION or name != self._name:
            self._refuse(stream)
        else:
            self._join(stream, hello)

    def _refuse(self, stream: socket.socket) -> None:
        RecordWriter(stream).push(Record(Kind.REFUSED, extra=LINK_VERSION, data=self._name.encode()).pack())
        stream.close()

    def _join(self, stream: socket.socket, hello: Record) -> None:
        listen_only = bool(hello.flags & Flag.LISTEN_ONLY)
        node = self._medium.attach(f"pid {hello.sequence}", listen_only=listen_only)
        stream.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        client = Client(node, secrets.randbits(62), stream, RecordWriter(stream), hello.flags)
        self.by_socket[stream] = client
        self.by_node[node] = client
        client.deliveries.push(self._welcome(client))

    def _welcome(self, client: Client) -> bytes:
        rates = f"{self._medium.bitrate} {self._medium.data_bitrate}".encode()
        return Record(Kind.WELCOME, 0, LINK_VERSION, 0, client.cookie, client.node, TX_QUEUE_LIMIT, rates).pack()

    def _join_transmit(self, stream: socket.socket, hello: Record) -> None:
        client = self.by_node.get(hello.sequence)
        if client is None or client.cookie != hello.stamp_ns or client.transmit is not None or client.deaf:
            self._refuse(stream)
            return
        client.transmit, client.credits, client.reader = stream, RecordWriter(stream), RecordReader(stream)
        self.by_socket[stream] = client
        self._medium.rename(client.node, hello.data.decode(errors="replace"))
        client.credits.push(self._welcome(client), keep=True)

    def stop_delivering(self, client: Client, now_ns: int) -> None:
        """The receiving side has closed; frames already on the transmitting side still count, up to its own end."""
        self.by_socket.pop(client.receive, None)
        client.receive.close()
        client.deaf = True
        if client.transmit is None:
            self.leave(client, now_ns)

    def leave(self, client: Client, now_ns: int) -> None:
        """The client has gone; its node stays until what it had queued is sent."""
        for stream in (client.receive, client.transmit):
            if stream is not None:
                self.by_socket.pop(stream, None)
                stream.close()
        client.deaf = True
        client.closing_ns = now_ns

    def close(self) -> None:
        """Close every connection and the listener."""
        for stream in [*self.pending, *self.by_socket, self.listener]:
            stream.close()
