"""Calls planned for a time, on one heap. The owner of the clock decides when each is due."""

from __future__ import annotations

import heapq
from collections.abc import Callable


class Agenda:
    """What is to be done when. Of several calls for one time, the one that was planned first comes first."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, Callable[[], None]]] = []
        self._turns = 0

    def at(self, when_ns: int, do: Callable[[], None]) -> None:
        """Plan a call."""
        heapq.heappush(self._heap, (when_ns, self.turn(), do))

    def turn(self) -> int:
        """The next place in the order of those who come at one time."""
        self._turns += 1
        return self._turns

    @property
    def next_ns(self) -> int | None:
        """When the next call is due; None where nothing is planned."""
        return self._heap[0][0] if self._heap else None

    def take_due(self, now_ns: int) -> Callable[[], None] | None:
        """Take the first call that is due by now, if any."""
        if self._heap and self._heap[0][0] <= now_ns:
            return heapq.heappop(self._heap)[2]
        return None
