"""Collects what happens in a run: signals to be judged, rows to be recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from hilbridge.limits import MS
from hilbridge.rows import Row
from hilscenario.signals.tracks import Tracks, Value

Record = Callable[[Row], None]


class RunLog:
    """Signals of one run, and its rows where somebody keeps a recording.

    Without a recording, rows of frames and of the device are not even made: ask `is_recorded` first.
    """

    def __init__(self, record: Record | None = None) -> None:
        self.tracks = Tracks()
        self.is_recorded = record is not None
        self.record: Record = _unrecorded if record is None else record

    def put(self, now_ns: int, signals: Mapping[str, Value]) -> None:
        """Note the values of signals."""
        time_ms = now_ns / MS
        for name, value in signals.items():
            self.tracks.put(time_ms, name, value)


def _unrecorded(row: Row) -> None:
    """Where nobody keeps a recording."""
