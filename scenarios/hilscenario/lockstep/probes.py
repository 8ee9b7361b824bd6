"""Samples the device's internal state every millisecond: the ground truth for expectations."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from firmware_sim.device import LOG_CYCLE_MS, ROW, Device
from firmware_sim.frames import STOP
from firmware_sim.memory import COUNT_TRIPS, Received
from firmware_sim.states import Reason, State, wire_name
from hilbridge.limits import MS
from hilbridge.rows import Row
from hilscenario.signals.device import NEVER_MS, device_row
from hilscenario.signals.tracks import Tracks

_EVERY_MS = 4  # angle and velocity: sampled, since they change in every tick


class DeviceProbe:
    """Turns the device's state of each tick into signals and recorded rows.

    `device.act_age_ms` is how long ago the last authorised ACT was accepted; `device.hold_age_ms` for how long accepted
    commands have said HOLD (0 while they say ACT), `device.stop_age_ms` for how long a STOP has stood.
    """

    def __init__(self, tracks: Tracks, record: Callable[[Row], None] | None) -> None:
        self._tracks, self._record = tracks, record
        self._hold_since_ms: int | None = None
        self._stopped_ms: int | None = None
        self._act_ms: int | None = None
        self._seen: tuple[object, ...] = ()
        self._mark: tuple[object, ...] = ()
        self.energy_j = 0.0
        self.assist_ms = 0

    def look(self, device: Device, now_ns: int, frames: Sequence[Received]) -> None:
        """Once after every tick."""
        state, torque, ticks = device.state, device.state.torque, device.ticks
        if state.command_live:
            if not state.command_is_hold:
                self._act_ms, self._hold_since_ms = state.command_ms, None
            elif self._hold_since_ms is None:
                self._hold_since_ms = state.last_tick_ms
        if frames and self._stopped_ms is None and any(frame.can_id == STOP for frame in frames):
            self._stopped_ms = state.last_tick_ms
        assist_unm, gravity_unm, trips = torque.assist_unm, torque.gravity_unm, state.counters[COUNT_TRIPS]
        # In most ticks nothing of this has changed, and one comparison says so.
        seen = (state.state, state.reason, state.armed, trips, assist_unm, gravity_unm)
        changed = seen != self._seen and self._put_changes(seen, now_ns / MS)
        if assist_unm or gravity_unm:
            self._spend(assist_unm, gravity_unm, device.arm.velocity, state.last_tick_ms, now_ns / MS)
        if ticks % _EVERY_MS == 0:
            self._put_arm(now_ns, device.arm.angle, device.arm.velocity)
        if self._record is not None and (changed or ticks % LOG_CYCLE_MS == 0):
            self._record(device_row(device.record(), now_ns))

    def pass_by(self, device: Device, path: Sequence[float], now_ns: int, tick_ns: int) -> None:
        """After ticks that `Device.coast` made at once: all but the last, in which state and frames stay as they were.

        `now_ns` is the time of the first. Torque is there in all of them or in none.
        """
        made = len(path) // ROW
        first = device.ticks - made
        if path[2] or path[3]:
            for passed in range(made - 1):
                tick_ms = device.state.last_tick_ms - made + 1 + passed
                self._pushed(path[ROW * passed : ROW * passed + ROW], tick_ms, (now_ns + passed * tick_ns) / MS)
        for ahead in range(-first % _EVERY_MS or _EVERY_MS, made, _EVERY_MS):
            self._put_arm(now_ns + (ahead - 1) * tick_ns, *path[ROW * (ahead - 1) : ROW * (ahead - 1) + 2])

    def _pushed(self, row: Sequence[float], tick_ms: int, time_ms: float) -> None:
        _, velocity, assist_unm, gravity_unm = row
        self._tracks.put(time_ms, "device.assist_nm", assist_unm * 1e-6)
        self._tracks.put(time_ms, "device.gravity_nm", gravity_unm * 1e-6)
        self._spend(assist_unm, gravity_unm, velocity, tick_ms, time_ms)

    def _spend(self, assist_unm: float, gravity_unm: float, velocity: float, tick_ms: int, time_ms: float) -> None:
        """Whatever an ACT adds is energy of it."""
        if assist_unm:
            self._put_ages(tick_ms, time_ms)
            self.assist_ms += 1
        self.energy_j += abs((assist_unm + gravity_unm) * 1e-6 * velocity) * 1e-3

    def _put_arm(self, now_ns: int, angle: float, velocity: float) -> None:
        put, time_ms = self._tracks.put, now_ns / MS
        put(time_ms, "device.angle_deg", round(57.29578 * angle, 3))
        put(time_ms, "device.velocity_deg_s", round(57.29578 * velocity, 3))

    def _put_changes(self, seen: tuple[State, Reason, bool, int, int, int], time_ms: float) -> bool:
        """Whether more has changed than the amount of torque."""
        self._seen = seen
        state, reason, armed, trips, assist_unm, gravity_unm = seen
        put, zero = self._tracks.put, assist_unm == 0
        put(time_ms, "device.assist_nm", assist_unm * 1e-6)
        put(time_ms, "device.gravity_nm", gravity_unm * 1e-6)
        mark = (state, reason, armed, trips, zero)
        if mark == self._mark:
            return False
        self._mark = mark
        put(time_ms, "device.state", wire_name(state))
        put(time_ms, "device.reason", wire_name(reason))
        put(time_ms, "device.armed", armed)
        put(time_ms, "device.assist_zero", zero)
        put(time_ms, "device.trips", float(trips))
        return True

    def _put_ages(self, tick_ms: int, time_ms: float) -> None:
        """Ages matter only while there is assist that they could forbid."""
        put = self._tracks.put
        put(time_ms, "device.act_age_ms", NEVER_MS if self._act_ms is None else float(tick_ms - self._act_ms))
        put(time_ms, "device.hold_age_ms", _age(self._hold_since_ms, tick_ms))
        put(time_ms, "device.stop_age_ms", _age(self._stopped_ms, tick_ms))


def _age(since_ms: int | None, now_ms: int) -> float:
    return 0.0 if since_ms is None else float(now_ms - since_ms)
