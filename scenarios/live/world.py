"""The device's world in a live run: its faults and the wearer's arm, as commands typed to the device."""

from __future__ import annotations

import math
from collections.abc import Callable

from hilbridge.rows import DeviceRow
from scenarios.world.arm import tremor_torque_nm
from scenarios.world.fault_board import Active, FaultBoard

# fault -> the command that makes it; what counts is what the device has obeyed
_LASTING = {"device.sensor_fault": "encoder", "device.actuator_lag": "lag", "device.torque_bias": "bias"}
_OVERRUN = "device.tick_overrun"
PUSHING = ("wearer.opposing", "wearer.tremor")


class DeviceWorld:
    """Types commands by `command`, and counts what came of them by the device's own log."""

    def __init__(self, board: FaultBoard, command: Callable[[str], None]) -> None:
        self._board, self._command = board, command
        self._obeyed: set[str] = set()
        self._pushed_nm = 0.0

    def change(self, active: Active) -> None:
        """A device fault begins or ends: the world as all that are under way make it, so that others stay as they are."""
        if active.step.fault == _OVERRUN:
            if self._board.get(_OVERRUN) is active:  # an instant: its end is nothing
                self._command(f"overrun {round(active['overrun_ms'])}")
            return
        self._obeyed -= set(_LASTING.values())
        sensor, lag, bias = map(self._board.get, _LASTING)
        self._command(f"encoder {0 if sensor is None else round(sensor['offset_deg'] * 1000)}")
        self._command("mend")
        if lag is not None:
            self._command(f"lag {lag['time_constant_ms']:g}")
        if bias is not None:
            self._command(f"bias {bias['bias_nm']:g}")

    def push(self, assist_nm: float, now_ns: int) -> bool:
        """What the wearer's arm does besides: trembles, pushes against the assist. True: ask again soon."""
        opposing, tremor = map(self._board.get, PUSHING)
        push_nm = 0.0 if tremor is None else tremor_torque_nm(tremor, now_ns)
        if opposing is not None and assist_nm:
            push_nm -= math.copysign(opposing["torque_nm"], assist_nm)
            opposing.took_effect("push" in self._obeyed)
        if push_nm != self._pushed_nm:
            self._pushed_nm = push_nm
            self._command(f"push {push_nm:.4f}")
        return opposing is not None or tremor is not None

    def obeyed(self, command: str) -> None:
        """The device's log has the command."""
        word = command.split()[0]
        self._obeyed.add(word)
        if word == "overrun":
            waiting = (one for one in self._board.all if one.step.fault == _OVERRUN and one.effects < one.strikes)
            if (active := next(waiting, None)) is not None:
                active.took_effect()

    def saw(self, row: DeviceRow) -> None:
        """A line of the device's log, with faults under way."""
        torque = any((row.assist_nm, row.gravity_nm, row.follow_nm))
        for fault, command in _LASTING.items():
            active = self._board.get(fault)
            # A lag does nothing to a motor that gives no torque.
            if active is not None and command in self._obeyed and (torque or command != "lag"):
                active.took_effect()
