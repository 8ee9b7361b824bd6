"""What a live run leaves behind to be judged and recorded."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(slots=True)
class Happened:
    """What a live run left: rows of both sides with their own stamps (monotonic ns), faults, and how it ended."""

    start_ns: int = 0
    device_rows: list[dict[str, Any]] = field(default_factory=list)
    bridge_rows: list[dict[str, Any]] = field(default_factory=list)  # topic, time_ns, row
    fault_signals: list[tuple[int, dict[str, bool]]] = field(default_factory=list)
    events: list[tuple[int, str]] = field(default_factory=list)
    away: list[tuple[int, str]] = field(default_factory=list)
    died: list[str] = field(default_factory=list)
    device_summary: dict[str, Any] = field(default_factory=dict)
    intruder_dropped: int = 0

    @property
    def ticks(self) -> list[tuple[int, dict[str, Any]]]:
        """The bridge's ticks, by time from the scenario's 0."""
        return [(row["time_ns"] - self.start_ns, row["row"]) for row in self.bridge_rows if row["topic"] == "/tick"]
