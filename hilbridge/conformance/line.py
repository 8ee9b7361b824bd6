"""What a tester needs of a bus: a clock, sending, and the next frame until a time. Virtual in tests, real in `bus_line`."""

from __future__ import annotations

from typing import Protocol

from hilbridge.records import Frame


class Line(Protocol):
    """One node's hold on a bus."""

    def now_ns(self) -> int:
        """The present on the clock that arrivals are stamped by."""

    def send(self, frame: Frame) -> None:
        """Send now. Raises Unshown where the frame does not go."""

    def receive(self, until_ns: int) -> Frame | None:
        """The next frame, or None once it is that late."""
