"""Virtual time: one clock, what is planned on it, and the device's tick among that."""

from __future__ import annotations

import heapq
from collections.abc import Callable

from hilscenario.world.agenda import Agenda


class WorldClock(Agenda):
    """The scenario's time, in ns from 0. It moves from one planned call to the next."""

    def __init__(self) -> None:
        super().__init__()
        self.time_ns = 0

    def now_ns(self) -> int:
        """The present."""
        return self.time_ns

    def wait_until(self, when_ns: int) -> None:
        """Called by the bus. It has nothing to wait for here: the agenda decides what comes next."""
        raise AssertionError("the lockstep engine never waits on its bus")

    def at(self, when_ns: int, do: Callable[[], None]) -> None:
        """Plan a call for `when_ns`, or for now if that is past."""
        super().at(max(when_ns, self.time_ns), do)

    def run(self, end_ns: int, tick_ns: int, on_tick: Callable[[int], None]) -> None:
        """Do what is planned, in order, until `end_ns`; call `on_tick` every `tick_ns` besides.

        The tick takes its turn among the others without being put on the heap, which it would be nearly all the work of.
        """
        heap = self._heap
        tick = (tick_ns, self.turn())
        while True:
            if heap and heap[0] < tick:
                if heap[0][0] > end_ns:
                    break
                self.time_ns, _, do = heapq.heappop(heap)
                do()
            elif tick[0] > end_ns:
                break
            else:
                self.time_ns = tick[0]
                on_tick(tick[0])
                tick = (tick[0] + tick_ns, self.turn())
        self.time_ns = end_ns
