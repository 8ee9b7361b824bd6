"""A one-slot, latest-value cell between a source and its reader, with every value accounted for.

A reader that is late gets the newest value, never a queue of old ones. After `close()` the books balance:
received == used + overwritten + failed.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class CellCounts:
    """Values that came in, and what became of each. `pending` is 1 while a value waits to be used."""

    received: int
    used: int
    overwritten: int
    failed: int
    pending: int

    @property
    def balanced(self) -> bool:
        return self.received == self.used + self.overwritten + self.failed + self.pending


class LatestCell(Generic[T]):
    """Thread-safe: one writer thread, one reader thread or event loop."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._value: T | None = None
        self._received = self._used = self._overwritten = self._failed = 0
        self._closed = False

    def put(self, value: T) -> None:
        """Leave a value; one still waiting is overwritten and counted. After `close()` it counts as overwritten."""
        with self._changed:
            self._received += 1
            if self._closed:
                self._overwritten += 1
                return
            if self._value is not None:
                self._overwritten += 1
            self._value = value
            self._changed.notify_all()

    def fail(self) -> None:
        """Count a value that arrived but could not be used (a picture that did not decode, a line out of format)."""
        with self._changed:
            self._received += 1
            self._failed += 1

    def take(self) -> T | None:
        """The waiting value, or None. Never blocks."""
        with self._changed:
            return self._take()

    def wait(self, timeout_s: float) -> T | None:
        """The waiting value, waiting at most so long for one; None on time-out or when the cell was closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._value is not None or self._closed, timeout_s)
            return self._take()

    def close(self) -> None:
        """No more readers: what still waits counts as overwritten."""
        with self._changed:
            self._closed = True
            if self._value is not None:
                self._overwritten += 1
                self._value = None
            self._changed.notify_all()

    def counts(self) -> CellCounts:
        with self._changed:
            pending = int(self._value is not None)
            return CellCounts(self._received, self._used, self._overwritten, self._failed, pending)

    def _take(self) -> T | None:
        value, self._value = self._value, None
        if value is not None:
            self._used += 1
        return value
