"""What is looked at on the device every millisecond, from inside: the truth that expectations are judged on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from firmware_sim.device import LOG_CYCLE_MS, Device
from firmware_sim.frames import STOP
from firmware_sim.memory import COUNT_TRIPS, Received
from scenarios.tracks import Tracks

MS = 1_000_000
NEVER_MS = 1e6
_EVERY_MS = 4  # angle and velocity: sampled, since they change in every tick
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


class DeviceProbe:
    """Turns the device's state of each tick into signals and recorded rows.

    `device.act_age_ms` is how long ago the last authorised ACT was accepted; `device.hold_age_ms` for how long accepted
    commands have said HOLD (0 while they say ACT), `device.stop_age_ms` for how long a STOP has stood.
    """

    def __init__(self, tracks: Tracks, record: Callable[[str, int, Mapping[str, Any]], None]) -> None:
        self._tracks, self._record = tracks, record
        self._hold_since_ms: int | None = None
        self._stopped_ms: int | None = None
        self._act_ms: int | None = None
        self._mark: tuple[object, ...] = ()
        self.energy_j = 0.0
        self.assist_ms = 0

    def look(self, device: Device, now_ns: int, frames: Sequence[Received]) -> None:
        """Once after every tick."""
        state, put, time_ms = device.state, self._tracks.put, now_ns / MS
        tick_ms = state.last_tick_ms
        if state.command_live and not state.command_is_hold:
            self._act_ms, self._hold_since_ms = state.command_ms, None
        elif state.command_live and state.command_is_hold and self._hold_since_ms is None:
            self._hold_since_ms = tick_ms
        if any(frame.can_id == STOP for frame in frames) and self._stopped_ms is None:
            self._stopped_ms = tick_ms
        assist_unm = state.torque.assist_unm
        zero = assist_unm == 0
        mark = (state.state, state.reason, state.armed, zero, state.counters[COUNT_TRIPS])
        changed = mark != self._mark
        if changed:
            self._mark = mark
            put(time_ms, "device.state", state.state.name)
            put(time_ms, "device.reason", state.reason.name)
            put(time_ms, "device.armed", state.armed)
            put(time_ms, "device.assist_zero", zero)
            put(time_ms, "device.trips", float(mark[4]))
        put(time_ms, "device.assist_nm", assist_unm * 1e-6)
        put(time_ms, "device.gravity_nm", state.torque.gravity_unm * 1e-6)
        if not zero:  # ages matter only while there is assist that they could forbid
            put(time_ms, "device.act_age_ms", NEVER_MS if self._act_ms is None else float(tick_ms - self._act_ms))
            put(time_ms, "device.hold_age_ms", _age(self._hold_since_ms, tick_ms))
            put(time_ms, "device.stop_age_ms", _age(self._stopped_ms, tick_ms))
            self.energy_j += abs(assist_unm * 1e-6 * device.arm.velocity) * 1e-3
            self.assist_ms += 1
        if device.ticks % _EVERY_MS == 0:
            put(time_ms, "device.angle_deg", round(57.29578 * device.arm.angle, 3))
            put(time_ms, "device.velocity_deg_s", round(57.29578 * device.arm.velocity, 3))
        if changed or device.ticks % LOG_CYCLE_MS == 0:
            self._record("/device", now_ns, device.record())


def _age(since_ms: int | None, now_ms: int) -> float:
    return 0.0 if since_ms is None else float(now_ms - since_ms)
