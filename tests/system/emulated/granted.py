"""The emulated board in its own time: its milliseconds are granted, so that no load of this computer changes what it does.

A grant ends early where the board sends a frame, so that whoever listens can answer in the next millisecond.
"""

from __future__ import annotations

import socket
from collections import deque

from hilbridge.limits import MS
from hilbridge.records import Frame
from tests.system.emulated.board import Board

_PATIENCE_S = 120.0


class GrantedLine:
    """A tester's line (hilbridge.conformance.line) onto a laboratory image, by SLCAN with grants (`g`, then how many)."""

    def __init__(self, board: Board) -> None:
        where = board.spec.rpartition("//")[2]
        host, _, port = where.partition(":")
        self._socket = socket.create_connection((host, int(port)), timeout=_PATIENCE_S)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._unread = b""
        self._ms = 1000
        self._now_ns = self._ms * MS
        self._outgoing = [b"g0001\rO\r"]
        self._arrived: deque[Frame] = deque()
        self._answer()

    def now_ns(self) -> int:
        return self._now_ns

    def send(self, frame: Frame) -> None:
        letter = ("tr" if not frame.is_extended else "TR")[frame.is_remote]
        number = f"{frame.can_id:0{8 if frame.is_extended else 3}X}"
        data = "" if frame.is_remote else frame.data.hex().upper()
        self._outgoing.append(f"{letter}{number}{len(frame.data)}{data}\r".encode())

    def receive(self, until_ns: int) -> Frame | None:
        while not self._arrived:
            whole = until_ns // MS - self._now_ns // MS
            if whole < 1:
                self._now_ns = max(self._now_ns, until_ns)
                return None
            self._outgoing.append(f"g{min(whole, 0xFFFF):04X}\r".encode())
            self._answer()
        return self._arrived.popleft()

    def _answer(self) -> None:
        """Send what waits; take in what the board says until its grant is used up, and set the clock by it."""
        self._socket.sendall(b"".join(self._outgoing))
        self._outgoing.clear()
        heard_now: list[Frame] = []
        while True:
            while b"\r" not in self._unread:
                heard = self._socket.recv(65536)
                assert heard, "the emulator has gone"
                self._unread += heard
            line, _, self._unread = self._unread.partition(b"\r")
            text = line.decode()
            if text.startswith("G"):
                self._now_ns = (self._now_ns // MS + int(text[1:], 16)) * MS
                self._arrived.extend(frame._replace(received_ns=self._now_ns) for frame in heard_now)
                return
            if text:
                heard_now.append(Frame(int(text[1:4], 16), bytes.fromhex(text[5:])))

    def close(self) -> None:
        self._socket.close()
