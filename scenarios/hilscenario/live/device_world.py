"""Device faults and the wearer's arm in a live run, sent to the device as text commands."""

from __future__ import annotations

from collections.abc import Callable

from hilbridge.rows import DeviceRow
from hilscenario.world.arm import PUSHING, opposing, push_nm
from hilscenario.world.device_faults import BIAS, ENCODER, LAG, OVERRUN, RESTART, WRONG_KEY, acting, broken
from hilscenario.world.fault_board import Active, FaultBoard

# fault -> its command; it took effect when the device's log shows it
_COMMANDS = {ENCODER: "encoder", LAG: "lag", BIAS: "bias"}
_INSTANTS = {"overrun": OVERRUN, "restart": RESTART, "wrongkey": WRONG_KEY}


class DeviceWorld:
    """Sends commands through `command`, and counts their effects by the device's log."""

    def __init__(self, board: FaultBoard, command: Callable[[str], None]) -> None:
        self._board, self._command = board, command
        self._obeyed: set[str] = set()
        self._pushed_nm = 0.0

    def change(self, active: Active) -> None:
        """A device fault begins or ends: send the complete set of faults under way."""
        if active.step.fault == OVERRUN:
            if self._board.get(OVERRUN) is active:  # an instant: its end is nothing
                self._command(f"overrun {round(active['overrun_ms'])}")
            return
        if active.step.fault in (RESTART, WRONG_KEY):
            under_way = self._board.get(active.step.fault) is active
            if under_way or active.step.fault == WRONG_KEY:
                self._command("wrongkey" if under_way and active.step.fault == WRONG_KEY else "restart")
            return
        self._obeyed -= set(_COMMANDS.values())
        wrong = broken(self._board)
        self._command(f"encoder {wrong.encoder_offset_mdeg}")
        self._command("mend")
        if wrong.lag_ms is not None:
            self._command(f"lag {wrong.lag_ms:g}")
        if wrong.bias_nm is not None:
            self._command(f"bias {wrong.bias_nm:g}")

    def push(self, assist_nm: float, now_ns: int) -> bool:
        """Send what the wearer's arm does. True while it does anything: call again soon."""
        torque_nm = push_nm(self._board, assist_nm, now_ns)
        if (against := opposing(self._board, assist_nm)) is not None:
            against.took_effect("push" in self._obeyed)
        if torque_nm != self._pushed_nm:
            self._pushed_nm = torque_nm
            self._command(f"push {torque_nm:.4f}")
        return any(self._board.get(fault) is not None for fault in PUSHING)

    def obeyed(self, command: str) -> None:
        """The device's log has the command."""
        word = command.split()[0]
        self._obeyed.add(word)
        if (fault := _INSTANTS.get(word)) is not None:
            waiting = (one for one in self._board.all if one.step.fault == fault and one.effects < one.injections)
            if (active := next(waiting, None)) is not None:
                active.took_effect()

    def saw(self, row: DeviceRow) -> None:
        """A line of the device's log, with faults under way."""
        torque = any((row.assist_nm, row.gravity_nm, row.follow_nm))
        for active in acting(self._board, torque):
            if _COMMANDS[active.step.fault] in self._obeyed:
                active.took_effect()
