"""The plant's side of its bus, a step at a time and without a clock: torque in, mechanics on, readings out, accounts kept."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_sim.bench.mechanics import Mechanics
from firmware_sim.bench.wire import JOINTS, Torque, step_frames

SILENT_STEPS = 5  # as long as a device may be late with its own tick
LATE_ECHO = 5  # steps between readings and their torque, from which on a device is late


@dataclass(slots=True)
class Account:
    """What happened, all counted from the start."""

    steps: int = 0
    late_steps: int = 0  # of this computer
    answers: int = 0
    late_answers: int = 0  # torque of readings that are LATE_ECHO steps old, or more
    repeated: int = 0  # torque frames with a counter that was there already
    lost: int = 0  # gaps in their counter
    silences: int = 0  # times that the device fell silent
    silent_steps: int = 0
    peak_unm: int = 0


class Plant:
    """`torque_unm` is what the motors are told now: the device's last word, or nothing once it has been silent."""

    def __init__(self, mechanics: Mechanics) -> None:
        self._mechanics = mechanics
        self.account = Account()
        self.torque_unm: tuple[int, ...] = (0,) * JOINTS
        self.silent = True  # until the device's first word
        self.press_steps = 0  # of the hand at the device
        self._counter = 0
        self._last: int | None = None
        self._quiet_steps = 0

    def hear(self, torque: Torque) -> None:
        """A DEVICE_TORQUE that has arrived. One that repeats a counter is not new, and feeds nothing."""
        account = self.account
        if self._last is not None:
            gap = (torque.counter - self._last) & 0xFF
            if gap == 0:
                account.repeated += 1
                return
            account.lost += gap - 1
        self._last = torque.counter
        account.answers += 1
        account.late_answers += (self._counter - torque.echo) & 0xFF >= LATE_ECHO
        account.peak_unm = max(account.peak_unm, *(abs(one) for one in torque.torque_unm))
        self.torque_unm = torque.torque_unm
        self.silent = False
        self._quiet_steps = 0

    def step(self, *, late: bool) -> list[tuple[int, bytes]]:
        """One millisecond of the arm; the frames of its readings. `late`: this computer came too late for it."""
        account = self.account
        account.steps += 1
        account.late_steps += late
        self._quiet_steps += 1
        if self._quiet_steps > SILENT_STEPS:
            account.silences += not self.silent
            account.silent_steps += 1
            self.silent = True
            self.torque_unm = (0,) * JOINTS
        self._mechanics.step(self.torque_unm)
        self._counter = (self._counter + 1) & 0xFF
        readings = self._mechanics.readings()
        if self.press_steps:
            self.press_steps -= 1
            readings = tuple(one._replace(hand=True) for one in readings)
        return step_frames(self._counter, readings)
