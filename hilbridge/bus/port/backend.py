"""What the port needs of whatever carries its frames: one protocol, which each backend keeps in a file of its own."""

from __future__ import annotations

from enum import StrEnum
from typing import Protocol

from hilbridge.records import Frame


class WriteResult(StrEnum):
    """What happened to a frame handed to the backend."""

    SENT = "sent"
    FULL = "full"
    DOWN = "down"
    REFUSED = "refused"


class LinkDown(Exception):
    """The bus is not there now. `reopen` says whether the backend must be opened anew once it is back."""

    def __init__(self, message: str, *, reopen: bool) -> None:
        super().__init__(message)
        self.reopen = reopen


class Backend(Protocol):
    """Carries frames without ever waiting. `overflowed` counts frames lost before they could be read."""

    is_physical: bool
    overflowed: int

    def fileno(self) -> int | None:
        """A descriptor readable while frames wait, or None: then `on_ready` of `start` is called from a thread."""

    def read(self) -> Frame | None:
        """One frame or None. Raises LinkDown."""

    def write(self, frame: Frame) -> WriteResult:
        """Hand over one frame without waiting."""

    def is_up(self) -> bool:
        """Whether the bus is there now."""

    def reopen(self) -> None:
        """Open anew after LinkDown with `reopen`. Raises BusUnavailable."""

    def close(self) -> None:
        """Release everything."""
