"""The time of a live run: the monotonic clock, counted from the scenario's 0."""

from __future__ import annotations

import time

from hilscenario.world.agenda import Agenda


class LiveClock(Agenda):
    """What is planned in a live run. `start_ns` is the scenario's 0 on the monotonic clock."""

    def __init__(self) -> None:
        super().__init__()
        self.start_ns = 0

    def now_ns(self) -> int:
        """The present, in ns from the scenario's 0."""
        return time.monotonic_ns() - self.start_ns
