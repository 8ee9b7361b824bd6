"""The lockstep engine's clock."""

from __future__ import annotations


class WorldClock:
    """The engine's time, for the bus."""

    def __init__(self) -> None:
        self.time_ns = 0

    def now_ns(self) -> int:
        """The present."""
        return self.time_ns

    def wait_until(self, when_ns: int) -> None:
        """Nobody waits here: the heap says what comes next."""
        raise AssertionError("the lockstep engine never waits on its bus")
