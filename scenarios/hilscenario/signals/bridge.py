"""The bridge's signals, from its 25 Hz rows: one place for virtual time and for live runs."""

from __future__ import annotations

from hilbridge.records import Action
from hilbridge.rows import TickRow
from hilscenario.signals.tracks import Value

UNKNOWN_AGE_MS = 1e6
_ABSENT: dict[str, Value] = {
    "gate.act": False,
    "gate.verb": "None",
    "gate.confidence": 0.0,
    "gate.right": False,
    "bridge.armed": False,
    "bridge.sensing_age_ms": UNKNOWN_AGE_MS,
}
# Before the first tick.
BRIDGE_AT_REST: dict[str, Value] = {
    **_ABSENT,
    "bridge.sensors_well": False,
    "gate.reason": "none",
    "wearer.intended": "None",
}


def bridge_signals(row: TickRow) -> dict[str, Value]:
    """What a tick's row says."""
    signals: dict[str, Value] = {
        "gate.act": row.action is Action.ACT,
        "gate.verb": str(row.verb),
        "gate.reason": str(row.reason),
        "gate.confidence": row.confidence,
        "bridge.armed": row.armed,
        "bridge.sensing_age_ms": UNKNOWN_AGE_MS if row.sensing_age_ms is None else row.sensing_age_ms,
        "bridge.sensors_well": row.sensor_problem is None,
    }
    if row.truth_known:
        signals |= {"gate.right": row.right is True, "wearer.intended": str(row.truth)}
    return signals


def absent_bridge(why: str) -> dict[str, Value]:
    """A bridge that hangs, stalls or is dead asks for nothing: its last values must not persist."""
    return {**_ABSENT, "gate.reason": why}
