"""The device's signals: their names, their values before the first tick, and a line of its log as signals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from scenarios.signals.tracks import Value

NEVER_MS = 1e6

# Before the first tick.
DEVICE_AT_REST: dict[str, float | str | bool] = {
    "device.state": "BOOT",
    "device.reason": "NONE",
    "device.armed": False,
    "device.assist_nm": 0.0,
    "device.gravity_nm": 0.0,
    "device.assist_zero": True,
    "device.act_age_ms": NEVER_MS,
    "device.hold_age_ms": 0.0,
    "device.stop_age_ms": 0.0,
    "device.trips": 0.0,
    "device.angle_deg": 0.0,
    "device.velocity_deg_s": 0.0,
}


def device_signals(row: Mapping[str, Any]) -> dict[str, Value]:
    """What one line says by itself."""
    return {
        "device.state": str(row["state"]),
        "device.reason": str(row["reason"]),
        "device.armed": bool(row["armed"]),
        "device.assist_zero": row["assist_nm"] == 0.0,
        "device.trips": float(row["trips"]),
        "device.assist_nm": float(row["assist_nm"]),
        "device.gravity_nm": float(row["gravity_nm"]),
        "device.angle_deg": float(row["angle_deg"]),
        "device.velocity_deg_s": float(row["velocity_deg_s"]),
    }
