"""Controller, actuator and arm wired together, tick by tick, without a clock: node and scenarios run this very code."""

from __future__ import annotations

import math
from dataclasses import replace
from math import degrees, sin
from typing import Any

from firmware_sim.controller import advance
from firmware_sim.memory import ControllerState, Inputs, Received
from firmware_sim.plant.actuator import LAG_S, Actuator
from firmware_sim.plant.arm import Arm, wearer_torque

_TICK_S = 0.001
LOG_CYCLE_MS = 20


class Device:
    """One simulated device. Faults of the world are its plain attributes; its controller has to find them out."""

    def __init__(self, state: ControllerState, wearer: str = "reach") -> None:
        """`state` is the controller at power-on; `wearer` one of plant.arm.WEARERS."""
        self.state = state
        self.arm = Arm()
        self.actuator = Actuator()
        self.wearer = wearer
        self.encoder_offset_mdeg = 0
        self.wearer_extra_nm = 0.0
        self.local_clear = False
        self.self_test_ok = True
        self.bus_off = False
        self.ticks = 0
        self.skipped_ms = 0
        self.follow_unm = 0
        self.peak_assist_unm = 0
        self._commanded_unm = 0
        self._dropped_seen = 0

    def tick(
        self, frames: tuple[Received, ...], random_u32: int, stall_ticks: int = 0, dropped: int = 0
    ) -> tuple[tuple[int, bytes], ...]:
        """One millisecond of the device's own time; `dropped` is the running total of frames it could not send.

        Returns the frames to send, in order.
        """
        self.ticks += 1
        now_ms = self.ticks + self.skipped_ms
        arm, actuator = self.arm, self.actuator
        wearer_nm = wearer_torque(self.wearer, arm, self.ticks * _TICK_S) + self.wearer_extra_nm
        angle = round(degrees(arm.angle) * 1000)
        inputs = Inputs(  # in the order of its fields: by their names they take twice the time
            frames,
            angle,
            angle + self.encoder_offset_mdeg,
            round(degrees(arm.velocity) * 1000),
            round(wearer_nm * 1e6) - round(2.0e6 * 0.85 * sin(arm.angle)),
            round(actuator.torque_nm * 1e6),
            self._commanded_unm,
            random_u32,
            self.bus_off,
            self.self_test_ok,
            self.local_clear,
            stall_ticks,
            dropped - self._dropped_seen,
        )
        self._dropped_seen = dropped
        self.local_clear = False
        outgoing, assist_unm, gravity_unm, self.follow_unm = advance(self.state, inputs, now_ms)
        if abs(assist_unm) > self.peak_assist_unm:
            self.peak_assist_unm = abs(assist_unm)
        self._commanded_unm = assist_unm + gravity_unm + self.follow_unm
        actuator.step(self._commanded_unm * 1e-6, _TICK_S)
        arm.step(actuator.torque_nm, wearer_nm, _TICK_S)
        return outgoing

    def skip(self, milliseconds: int) -> None:
        """Injected overrun: the device's own clock moves on without its control loop (`tick_overrun`)."""
        self.skipped_ms += milliseconds

    def break_motor(
        self, *, gain: float = 1.0, stuck: bool = False, lag_s: float = LAG_S, bias_nm: float = 0.0
    ) -> None:
        """Faults of the actuator: its gain, where it is stuck, how late it follows, what it adds; bare: healthy again."""
        self.actuator = replace(self.actuator, gain=gain, stuck=stuck, lag_s=lag_s, bias_nm=bias_nm)

    def record(self) -> dict[str, Any]:
        """The present tick as one line of the JSON log: units in the names, times on the device's own clock."""
        state = self.state
        return {
            "t_ms": state.last_tick_ms,
            "state": state.state.name,
            "reason": state.reason.name,
            "armed": state.armed,
            "session": state.session,
            "verb": state.verb,
            "assist_nm": state.torque.assist_unm * 1e-6,
            "gravity_nm": state.torque.gravity_unm * 1e-6,
            "follow_nm": self.follow_unm * 1e-6,
            "angle_deg": round(math.degrees(self.arm.angle), 3),
            "velocity_deg_s": round(math.degrees(self.arm.velocity), 3),
            "accepted_ms": state.command_ms,
            "accepted_counter": state.accepted_counter,
            "accepted_hold": state.command_is_hold,
            "trips": len(state.trips),
        }
