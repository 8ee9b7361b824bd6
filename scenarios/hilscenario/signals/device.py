"""The device's signals: their values before the first tick, a line of its log as a row, a row as signals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hilbridge.rows import DeviceRow, Witness
from hilbridge.wire.codec import Codec
from hilscenario.signals.tracks import Value

NEVER_MS = 1e6

# Before the first tick.
DEVICE_AT_REST: dict[str, Value] = {
    "device.state": "Boot",
    "device.reason": "None",
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


def _names(message: str, signal: str) -> Mapping[int, str]:
    """A value table of the DBC."""
    layout = Codec().messages[message]
    signals = (*layout.signals, layout.multiplexer)
    names = next(one.names for one in signals if one is not None and one.name == signal)
    assert names is not None
    return names


_VERB_NAMES = _names("CTRL_STATUS", "AppliedVerb")
# The device's counters in their order, as CTRL_DIAG names them.
DEVICE_COUNTERS = tuple(name for _, name in sorted(_names("CTRL_DIAG", "Index").items()))


@dataclass(frozen=True, slots=True)
class DeviceLine:
    """A line of the device's own log: its row, and what only a live run needs to count ages.

    accepted_live: an accepted command stands. stop_ms: when STOP came, on the device's own clock.
    """

    row: DeviceRow
    accepted_live: bool
    stop_ms: int | None


def device_row(line: Mapping[str, Any], time_ns: int) -> DeviceRow:
    """What the device says of one tick (`Device.record`), as a row."""
    return DeviceRow(
        time_ns,
        Witness.DEVICE,
        line["state"],
        line["reason"],
        line["armed"],
        _VERB_NAMES.get(line["verb"], str(line["verb"])),
        line["assist_nm"] == 0.0,
        line["assist_nm"],
        line["gravity_nm"],
        line["follow_nm"],
        line["angle_deg"],
        line["velocity_deg_s"],
        session=line["session"],
        trips=line["trips"],
        device_ms=line["t_ms"],
        accepted_ms=line["accepted_ms"],
        accepted_counter=line["accepted_counter"],
        accepted_hold=line["accepted_hold"],
    )


def device_line(line: Mapping[str, Any]) -> DeviceLine:
    """A line of the log that `firmware-sim` writes."""
    return DeviceLine(device_row(line, line["ends_ns"]), line["accepted_live"], line["stop_ms"])


def device_signals(row: DeviceRow) -> dict[str, Value]:
    """What one row of the device's own says by itself."""
    assert row.witness is Witness.DEVICE
    return {
        "device.state": row.state,
        "device.reason": row.reason,
        "device.armed": row.armed,
        "device.assist_zero": row.assist_zero,
        "device.trips": float(row.trips or 0),
        "device.assist_nm": row.assist_nm or 0.0,
        "device.gravity_nm": row.gravity_nm or 0.0,
        "device.angle_deg": row.angle_deg or 0.0,
        "device.velocity_deg_s": row.velocity_deg_s or 0.0,
    }
