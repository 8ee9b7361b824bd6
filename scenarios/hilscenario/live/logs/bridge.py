"""The bridge's rows as signals; a gap in the rows is a bridge that does not run. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from hilbridge.limits import MS, TICK_NS
from hilbridge.rows import TickRow
from hilscenario.signals.bridge import absent_bridge, bridge_signals
from hilscenario.signals.tracks import Tracks, Value
from hilscenario.world.fault_board import FOREVER_NS

# The device's command time-out: a bridge silent for so long no longer asks for anything.
SILENT_NS = 100 * MS


def put_bridge(tracks: Tracks, ticks: Sequence[TickRow], away: Iterable[tuple[int, str]]) -> None:
    """Put the bridge's signals: its rows by time (ns from the scenario's 0), and when it was hung, stalled or killed."""
    told: list[tuple[int, dict[str, Value]]] = [(when_ns, absent_bridge(why)) for when_ns, why in away]
    told += [(row.time_ns, bridge_signals(row)) for row in ticks]
    ends_ns = [row.time_ns for row in ticks[1:]] + [FOREVER_NS]
    for row, end_ns in zip(ticks, ends_ns, strict=False):
        if end_ns - row.time_ns > SILENT_NS:
            told.append((row.time_ns + SILENT_NS, absent_bridge("silent")))
    for now_ns, signals in sorted(told, key=lambda entry: entry[0]):
        for name, value in signals.items():
            if value == "silent" and tracks.now.get("gate.reason") in ("hung", "stalled", "dead"):
                continue  # it is known why
            tracks.put(max(0, now_ns) / MS, name, value)


def missing_ticks(ticks: Sequence[TickRow], from_ns: int, until_ns: int) -> int:
    """How many of the ticks that were due in that time were not there."""
    had = sum(from_ns <= row.time_ns < until_ns for row in ticks)
    return max(0, (until_ns - from_ns) // TICK_NS - had)
