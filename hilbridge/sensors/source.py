"""What every sensor source has in common: a thread that fills one cell, a health that can be read, a clean end."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from enum import StrEnum
from typing import Generic, TypeVar

from hilbridge.priority import Level, take_level
from hilbridge.sensors.cell import LatestCell

T = TypeVar("T")
_LEAST_SPACING_NS = 1_000_000  # where there is but one sample


class SourceState(StrEnum):
    """Whether a source delivers. Only RUNNING lets its values count; the rest are reasons to hold."""

    STARTING = "starting"
    RUNNING = "running"
    GONE = "gone"  # was there, is not now; the source tries to get it back
    ENDED = "ended"  # a recording that was played to its end


def begins_again_ns(started_ns: int, last_ns: int, spacing_ns: int, now_ns: int) -> int:
    """When a recording that is played in a loop begins again: its last sample has lasted as long as the one before it.

    So recordings of one length stay in step, and a camera's rate has no seam. `last_ns`: of the last sample, from the start.
    """
    return max(now_ns, started_ns + last_ns + max(spacing_ns, _LEAST_SPACING_NS))


class Source(ABC, Generic[T]):
    """A thread that reads one device or recording into `cell`. `start()` it once, `stop()` it once.

    `clock_ns` is the monotonic clock; a test hands in its own. `live`: it plays no recording.
    """

    live = False

    def __init__(self, name: str, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self.name = name
        self.cell: LatestCell[T] = LatestCell()
        self.state = SourceState.STARTING
        self.detail = ""
        self.last_captured_ns: int | None = None
        self.on_value: Callable[[T], None] = lambda value: None  # called in the source's thread with each value
        self.on_event: Callable[[str], None] = lambda text: None  # likewise, with what a person would want to know
        self.adjust: Callable[[T], T] = lambda value: value  # each value before it is handed on
        self._clock_ns = clock_ns
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self, timeout_s: float = 2.0) -> None:
        """End the thread, release the device, close the books."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(timeout_s)
        self.cell.close()

    @abstractmethod
    def _read_all(self) -> None:
        """Read until the source ends or `_stopping` is set."""

    def _run(self) -> None:
        take_level(Level.SENSORS)
        try:
            self._read_all()
        except Exception as error:  # a driver may raise anything; the bridge must see it as a sensor that is gone
            self.state, self.detail = SourceState.GONE, f"{type(error).__name__}: {error}"
            return
        if not self._stopping.is_set():
            self.state = SourceState.ENDED

    def _deliver(self, value: T, captured_ns: int) -> None:
        self.last_captured_ns = captured_ns
        self.state, self.detail = SourceState.RUNNING, ""
        value = self.adjust(value)
        self.cell.put(value)
        self.on_value(value)

    def _sleep_until(self, due_ns: int) -> bool:
        """Wait for a moment of the monotonic clock; False when the source is to stop."""
        wait_s = (due_ns - self._clock_ns()) / 1e9
        return not self._stopping.wait(max(wait_s, 0.0))
