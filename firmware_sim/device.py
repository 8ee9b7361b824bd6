"""Controller, actuator and arm, stepped together without a clock. The node and the scenarios run this same code."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import sin
from typing import Any

from firmware_sim.controllers import name_of, power_on, step_of
from firmware_sim.memory import ControllerState, Inputs, Received
from firmware_sim.plant.actuator import LAG_S, Actuator
from firmware_sim.plant.arm import CARRIED_UNM, MDEG, TICK_S, WEARERS, Arm, wearer_torque
from firmware_sim.states import wire_name

LOG_CYCLE_MS = 20
ROW = 4  # numbers that `Device.coast` tells of each tick
Muscles = Callable[[Arm, float], float]  # torque in N m at a time in s


class Device:
    """One simulated device. Physical faults are plain attributes; the controller has to detect them."""

    def __init__(self, state: ControllerState, wearer: str | Muscles = "reach") -> None:
        """`state` is the controller at power-on; `wearer` one of plant.arm.WEARERS, or muscles of one's own."""
        self.state = state
        self._advance = step_of(state)
        self.arm = Arm()
        self.actuator = Actuator()
        self.muscles: Muscles = partial(wearer_torque, wearer) if isinstance(wearer, str) else wearer
        self._wearer = WEARERS.index(wearer) if isinstance(wearer, str) else None
        self.encoder_offset_mdeg = 0
        self.wearer_extra_nm = 0.0
        self.local_clear = False
        self.self_test_ok = True
        self.bus_off = False
        self.ticks = 0
        self.skipped_ms = 0
        self.peak_assist_unm = 0
        self._inputs = Inputs()
        self._commanded_unm = 0
        self._dropped_seen = 0

    def tick(
        self, frames: tuple[Received, ...], random_u32: int, stall_ticks: int = 0, dropped: int = 0
    ) -> tuple[tuple[int, bytes], ...]:
        """One millisecond of the device's own time; `dropped` is the running total of frames it could not send.

        Returns the frames to send, in order.
        """
        self.ticks += 1
        state, arm, actuator, inputs = self.state, self.arm, self.actuator, self._inputs
        wearer_nm = self.muscles(arm, self.ticks * TICK_S) + self.wearer_extra_nm
        angle = round(arm.angle * MDEG)
        inputs.frames = frames
        inputs.angle_mdeg = angle
        inputs.second_angle_mdeg = angle + self.encoder_offset_mdeg
        inputs.velocity_mdeg_s = round(arm.velocity * MDEG)
        inputs.user_torque_unm = round(wearer_nm * 1e6) - round(CARRIED_UNM * sin(arm.angle))
        inputs.measured_unm = round(actuator.torque_nm * 1e6)
        inputs.commanded_unm = self._commanded_unm
        inputs.random_u32 = random_u32
        inputs.bus_off = self.bus_off
        inputs.self_test_ok = self.self_test_ok
        inputs.local_clear = self.local_clear
        inputs.stall_ticks = stall_ticks
        inputs.tx_dropped = dropped - self._dropped_seen
        self._dropped_seen = dropped
        self.local_clear = False
        self._advance(state, inputs, self.ticks + self.skipped_ms)
        law = state.torque
        if abs(law.assist_unm) > self.peak_assist_unm:
            self.peak_assist_unm = abs(law.assist_unm)
        self._commanded_unm = law.assist_unm + law.gravity_unm + state.follow_unm
        actuator.step(self._commanded_unm * 1e-6, TICK_S)
        arm.step(actuator.torque_nm, wearer_nm, TICK_S)
        return state.outbox

    def coast(self, most: int, dropped: int = 0) -> tuple[tuple[tuple[int, bytes], ...], tuple[float, ...]]:
        """Ticks without frames: `most`, or until one sends something, or what anybody watches has changed.

        Returns what the last one sends; and angle, velocity, assist and support after each, in one list.
        """
        state, arm, actuator = self.state, self.arm, self.actuator
        hindered = actuator.stuck or self.local_clear or dropped != self._dropped_seen
        if hindered or self._wearer is None or isinstance(state, ControllerState):
            sent, law = self.tick((), 0, 0, dropped), state.torque
            return sent, (arm.angle, arm.velocity, law.assist_unm, law.gravity_unm)
        elbow = (
            self._wearer, arm.angle, arm.velocity, actuator.torque_nm, actuator.gain, actuator.lag_s, actuator.bias_nm,
            self.wearer_extra_nm, self.encoder_offset_mdeg, self._commanded_unm,
        )  # fmt: skip
        done, actuator.torque_nm, self._commanded_unm, self.peak_assist_unm, path = state.coast(
            (self.ticks, self.skipped_ms, most), elbow, self.self_test_ok, self.bus_off, self.peak_assist_unm
        )
        self.ticks += done
        arm.angle, arm.velocity = path[-ROW], path[1 - ROW]
        return state.outbox, path

    def skip(self, milliseconds: int) -> None:
        """Injected overrun: the device's own clock moves on without its control loop (`tick_overrun`)."""
        self.skipped_ms += milliseconds

    def start_anew(self, key: bytes, boot_nonce: int) -> None:
        """Power lost and back at once: the controller begins with nothing remembered; the arm is where it was."""
        state = self.state
        self.state = power_on(name_of(state), key, boot_nonce, state.limits, state.profiles)

    def break_motor(
        self, *, gain: float = 1.0, stuck: bool = False, lag_s: float = LAG_S, bias_nm: float = 0.0
    ) -> None:
        """Faults of the actuator: its gain, where it is stuck, how late it follows, what it adds; bare: healthy again."""
        self.actuator = replace(self.actuator, gain=gain, stuck=stuck, lag_s=lag_s, bias_nm=bias_nm)

    def record(self) -> dict[str, Any]:
        """The present tick as one line of the JSON log."""
        return record_of(self.state, math.degrees(self.arm.angle), math.degrees(self.arm.velocity))


def record_of(state: ControllerState, angle_deg: float, velocity_deg_s: float) -> dict[str, Any]:
    """One tick as a line of the JSON log: units in the names, times on the device's own clock."""
    return {
        "t_ms": state.last_tick_ms,
        "state": wire_name(state.state),
        "reason": wire_name(state.reason),
        "armed": state.armed,
        "session": state.session,
        "verb": state.verb,
        "assist_nm": state.torque.assist_unm * 1e-6,
        "gravity_nm": state.torque.gravity_unm * 1e-6,
        "follow_nm": state.follow_unm * 1e-6,
        "angle_deg": round(angle_deg, 3),
        "velocity_deg_s": round(velocity_deg_s, 3),
        "accepted_ms": state.command_ms,
        "accepted_counter": state.accepted_counter,
        "accepted_hold": state.command_is_hold,
        "trips": len(state.trips),
    }
