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
        self.tick_ns = 1
        self._end_ns = 0

    def now_ns(self) -> int:
        """The present."""
        return self.time_ns

    def wait_until(self, when_ns: int) -> None:
        """Called by the bus. It has nothing to wait for here: the agenda decides what comes next."""
        raise AssertionError("the lockstep engine never waits on its bus")

    def at(self, when_ns: int, do: Callable[[], None]) -> None:
        """Plan a call for `when_ns`, or for now if that is past."""
        super().at(max(when_ns, self.time_ns), do)

    def ticks_alone(self, until_ns: int) -> int:
        """How many ticks, the present one among them, come before the next planned call, the end, and `until_ns`."""
        free_ns = min(until_ns, self._end_ns + 1, self._heap[0][0] if self._heap else until_ns)
        return max(1, -((self.time_ns - free_ns) // self.tick_ns))

    def pass_ticks(self, ticks: int) -> int:
        """So many ticks were made at once: it is now the time of the last one."""
        self.time_ns += (ticks - 1) * self.tick_ns
        return self.time_ns

    def run(self, end_ns: int, tick_ns: int, on_tick: Callable[[int], None]) -> None:
        """Do what is planned, in order, until `end_ns`; call `on_tick` every `tick_ns` besides.

        The tick takes its turn among the others without being put on the heap, which it would be nearly all the work of.
        It may be several at once (`ticks_alone`, `pass_ticks`).
        """
        heap = self._heap
        self._end_ns, self.tick_ns = end_ns, tick_ns
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
                tick = (self.time_ns + tick_ns, self.turn())
        self.time_ns = end_ns
