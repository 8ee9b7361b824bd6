"""The device's own log as signals: what virtual time reads off the device each millisecond, from lines 5 ms apart. Pure.

Words and flags change with the line that shows them, and every change has a line. Torque and movement are interpolated
linearly. Ages are on the device's own clock, so that a stalled computer is not mistaken for a stalled device.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hilbridge.limits import MS
from hilbridge.rows import DeviceRow
from hilscenario.signals.device import DEVICE_AT_REST, DeviceLine, device_signals
from hilscenario.signals.tracks import Value

Column = NDArray[np.float64] | NDArray[np.object_]


class Ages:
    """When the device last took an ACT, since when it holds, when STOP came; fed with the log's lines in order."""

    def __init__(self) -> None:
        self.act_ms: int | None = None
        self.hold_since_ms: int | None = None
        self.stop_ms: int | None = None

    def take(self, line: DeviceLine) -> None:
        """The next line."""
        row, self.stop_ms = line.row, line.stop_ms
        if not line.accepted_live:
            return
        if not row.accepted_hold:
            self.act_ms, self.hold_since_ms = row.accepted_ms, None
        elif self.hold_since_ms is None:
            self.hold_since_ms = row.device_ms

    @property
    def since(self) -> dict[str, int | None]:
        """By signal: from which moment of the device's clock it counts."""
        return {
            "device.act_age_ms": self.act_ms,
            "device.hold_age_ms": self.hold_since_ms,
            "device.stop_age_ms": self.stop_ms,
        }


_STRAIGHT = ("device.assist_nm", "device.gravity_nm", "device.angle_deg", "device.velocity_deg_s")


def device_now(row: DeviceRow, ages: Ages) -> dict[str, Value]:
    """Every signal of the device at one line, for conditions; `ages` has taken it in."""
    counted = {
        name: float(DEVICE_AT_REST[name]) if since_ms is None else float((row.device_ms or 0) - since_ms)
        for name, since_ms in ages.since.items()
    }
    return {**device_signals(row), **counted}


def device_columns(lines: Sequence[DeviceLine], start_ns: int, length: int) -> dict[str, Column]:
    """Every signal of the device on the grid of `length` milliseconds from `start_ns` of the monotonic clock."""
    ages = Ages()
    told: list[dict[str, Value]] = []
    since: list[dict[str, int | None]] = []
    for line in lines:
        ages.take(line)
        told.append(device_signals(line.row))
        since.append(ages.since)
    at_ms = np.array([(line.row.time_ns - start_ns) / MS for line in lines])
    grid = np.arange(length, dtype=np.float64)
    held = np.maximum(np.searchsorted(at_ms, grid, side="right") - 1, 0)
    device_ms = np.array([line.row.device_ms for line in lines], np.float64)[held] + np.maximum(grid - at_ms[held], 0.0)
    columns: dict[str, Column] = {}
    for name in told[0]:
        values = [signals[name] for signals in told]
        if isinstance(values[0], str):
            columns[name] = np.array(values, dtype=object)[held]
        elif name in _STRAIGHT:
            columns[name] = np.interp(grid, at_ms, np.array(values, np.float64))
        else:
            columns[name] = np.array(values, np.float64)[held]
    for name in since[0]:
        from_ms = np.array([np.nan if row[name] is None else row[name] for row in since], np.float64)[held]
        columns[name] = np.where(np.isnan(from_ms), float(DEVICE_AT_REST[name]), device_ms - from_ms)
    return columns


def assist_figures(columns: Mapping[str, Column]) -> dict[str, float]:
    """assist_s and assist_energy_j (J between arm and all that an ACT adds, gravity support too), from the grid."""
    acting = np.asarray(columns["device.assist_zero"], np.float64) == 0.0
    assist_nm = np.where(acting, np.asarray(columns["device.assist_nm"], np.float64), 0.0)
    added_nm = assist_nm + np.asarray(columns["device.gravity_nm"], np.float64)
    speed_rad_s = np.radians(np.asarray(columns["device.velocity_deg_s"], np.float64))
    return {
        "assist_s": float(acting.sum()) / 1000.0,
        "assist_energy_j": float(np.abs(added_nm * speed_rad_s).sum()) * 1e-3,
    }
