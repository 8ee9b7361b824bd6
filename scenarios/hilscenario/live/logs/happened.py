"""The result of a live run, to be judged and recorded."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from hilbridge.rows import FaultRow, Row, TickRow
from hilscenario.signals.device import DeviceLine


@dataclass(slots=True)
class Happened:
    """What a live run left: rows of both sides with their own stamps (monotonic ns), faults, and how it ended."""

    start_ns: int = 0
    device_lines: list[DeviceLine] = field(default_factory=list)
    bridge_rows: list[Row] = field(default_factory=list)
    fault_signals: list[tuple[int, dict[str, bool]]] = field(default_factory=list)
    events: list[tuple[int, str]] = field(default_factory=list)
    faults: list[FaultRow] = field(default_factory=list)
    away: list[tuple[int, str]] = field(default_factory=list)
    died: list[str] = field(default_factory=list)
    device_summary: dict[str, Any] = field(default_factory=dict)
    intruder_dropped: int = 0

    @property
    def ticks(self) -> list[TickRow]:
        """The bridge's ticks, by time from the scenario's 0."""
        ticks = (row for row in self.bridge_rows if isinstance(row, TickRow))
        return [replace(row, time_ns=row.time_ns - self.start_ns) for row in ticks]
