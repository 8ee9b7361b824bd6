"""A LAWICEL (slcan) serial adapter on the far end of a pseudo-terminal, for tests."""

from __future__ import annotations

import os
import select
import threading
from pathlib import Path

WAIT_S = 20.0


class FakeAdapter:
    """Speaks the LAWICEL protocol on the far end of a pseudo-terminal: S6, O, C, V, t and T; answers as real ones do."""

    def __init__(self, link: Path) -> None:
        import tty

        self._master, slave = os.openpty()
        tty.setraw(self._master)
        tty.setraw(slave)
        self._slave = slave
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(slave))
        self._unplugged = os.pipe()
        self.is_open = threading.Event()
        self.commands: list[bytes] = []
        self.sent: list[bytes] = []
        self.sent_some = threading.Condition()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        pending = b""
        while True:
            readable, _, _ = select.select([self._master, self._unplugged[0]], [], [])
            if self._unplugged[0] in readable:
                return
            pending += os.read(self._master, 256)
            *commands, pending = pending.split(b"\r")
            for command in commands:
                self._answer(command)

    def _answer(self, command: bytes) -> None:
        self.commands.append(command)
        if command[:1] in (b"t", b"T"):
            with self.sent_some:
                self.sent.append(command)
                self.sent_some.notify_all()
            os.write(self._master, b"z\r" if command[:1] == b"t" else b"Z\r")
            return
        if command == b"O":
            self.is_open.set()
        os.write(self._master, b"\r")

    def inject(self, raw: bytes) -> None:
        """Let the adapter report a frame from the bus."""
        os.write(self._master, raw)

    def wait_sent(self, count: int) -> list[bytes]:
        with self.sent_some:
            assert self.sent_some.wait_for(lambda: len(self.sent) >= count, WAIT_S)
            return list(self.sent)

    def unplug(self) -> None:
        os.write(self._unplugged[1], b"x")  # closing under a reading thread would not hang the line up
        self._thread.join()
        for descriptor in (self._slave, self._master, *self._unplugged):
            os.close(descriptor)
