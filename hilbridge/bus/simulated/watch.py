"""Waits for sockets to be ready, as precisely as a bus needs."""

from __future__ import annotations

import select
import selectors
import socket
import sys
from typing import Any

READ, WRITE = selectors.EVENT_READ, selectors.EVENT_WRITE


class Watch:
    """A selector whose time-outs end within microseconds; each socket is watched in the name of its owner."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        # epoll counts in milliseconds, a frame lasts a quarter of one: select() on the epoll itself counts in microseconds.
        self._coarse = self._selector if sys.platform == "linux" else None

    def add(self, stream: socket.socket, owner: Any = None) -> None:
        """Wait until it is readable."""
        self._selector.register(stream, READ, owner)

    def remove(self, stream: socket.socket) -> None:
        """Before it is closed; one that is closed or not watched may be named."""
        if self._has(stream):
            self._selector.unregister(stream)

    def change(self, stream: socket.socket, events: int, owner: Any = None) -> None:
        """Wait for other events, or for another owner; nothing for a socket that is not watched."""
        if self._has(stream):
            self._selector.modify(stream, events, owner)

    def _has(self, stream: socket.socket) -> bool:
        return stream.fileno() >= 0 and stream in self._selector.get_map()

    def wait(self, timeout_s: float) -> list[tuple[socket.socket, int, Any]]:
        """What is ready: socket, events, owner."""
        if timeout_s > 0 and self._coarse is not None:
            select.select([self._coarse], [], [], timeout_s)
            timeout_s = 0.0
        return [(key.fileobj, events, key.data) for key, events in self._selector.select(timeout_s)]  # type: ignore[misc]

    def close(self) -> None:
        """Watch nothing any more."""
        self._selector.close()
