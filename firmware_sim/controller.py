"""The controller's 1 kHz step: (state, inputs, now) -> (state, outputs). No clock, no bus, no I/O, integers only.

Order within a tick: device faults, frames in the order of their arrival, deadlines, torque, transmission. So a command
can never outrun a fault of the same tick, and what is sent describes the tick's end.
"""

from __future__ import annotations

from copy import copy

from firmware_sim import torque, watchdogs
from firmware_sim.faults import SELF_TEST_MS, bus_off, command_overdue, disarm, fire, trip
from firmware_sim.memory import (
    COUNT_BUS_OFFS,
    COUNT_STALL_TICKS,
    COUNT_TX_DROPPED,
    ControllerState,
    Inputs,
    Outputs,
    count,
)
from firmware_sim.profiles import NONE, profile
from firmware_sim.receive import authorisation_missing, receive
from firmware_sim.selftest import passed
from firmware_sim.states import Event, Reason, State
from firmware_sim.transmit import send_cyclic

_NO_FOLLOW = (State.BOOT, State.SELFTEST, State.PASSIVE)
_PLANT_FAULTS = (Reason.TORQUE_TRACKING, Reason.JOINT_SPEED, Reason.RANGE_OF_MOTION)


def step(before: ControllerState, inputs: Inputs, now_ms: int) -> tuple[ControllerState, Outputs]:
    """One tick. `now_ms` is the device's own time and grows by one per tick; a gap of 5 ms or more latches.

    `before` is not touched. Never raises on anything that comes from the bus.
    """
    state = copy(before)
    state.outbox = ()
    _device_faults(state, inputs, now_ms)
    for frame in inputs.frames:
        receive(state, frame, inputs.random_u32, now_ms)
    _deadlines(state, inputs, now_ms)
    _torque(state, inputs, now_ms)
    send_cyclic(state, inputs, state.state != before.state, now_ms)
    state.last_tick_ms = now_ms
    sensors_lost = state.state in _NO_FOLLOW or state.implausible_ticks >= watchdogs.IMPLAUSIBLE_TICKS
    if sensors_lost or state.reason in _PLANT_FAULTS:  # which are reasons of a latch alone
        follow = 0
    else:
        follow = torque.follow_torque(inputs.angle_mdeg, inputs.velocity_mdeg_s)
    return state, Outputs(state.outbox, state.torque.assist_unm, state.torque.gravity_unm, follow)


def _device_faults(state: ControllerState, inputs: Inputs, now_ms: int) -> None:
    """What the device can tell about itself: its tick, its transceiver, its sensors, its actuator, its arm."""
    if inputs.stall_ticks:
        count(state, COUNT_STALL_TICKS, inputs.stall_ticks)
    if inputs.tx_dropped:
        count(state, COUNT_TX_DROPPED, inputs.tx_dropped)
    if state.last_tick_ms and watchdogs.expired(state.last_tick_ms, now_ms, watchdogs.TICK_LIMIT_MS):
        fire(state, Event.LATCH, Reason.TICK_OVERRUN, now_ms)
    if inputs.bus_off and not state.was_bus_off:
        count(state, COUNT_BUS_OFFS)
        bus_off(state, now_ms)
    state.was_bus_off = inputs.bus_off
    previous = inputs.angle_mdeg if state.previous_mdeg is None else state.previous_mdeg
    bad = watchdogs.implausible(inputs.angle_mdeg, inputs.second_angle_mdeg, previous)
    state.previous_mdeg = inputs.angle_mdeg
    state.implausible_ticks = watchdogs.run_length(state.implausible_ticks, bad)
    state.healthy_ticks = watchdogs.run_length(state.healthy_ticks, not bad)
    if state.implausible_ticks >= watchdogs.IMPLAUSIBLE_TICKS:
        disarm(state)
        fire(state, Event.SENSORS_BAD, Reason.SENSOR_IMPLAUSIBLE, now_ms)
        return
    if state.healthy_ticks >= watchdogs.HEALTHY_TICKS:
        fire(state, Event.SENSORS_GOOD, Reason.SENSOR_IMPLAUSIBLE, now_ms)
    if not bad:
        _plant(state, inputs, now_ms)


def _plant(state: ControllerState, inputs: Inputs, now_ms: int) -> None:
    limits = state.limits
    strayed = abs(inputs.commanded_unm - inputs.measured_unm) > limits.tracking_limit_unm
    state.tracking_ticks = watchdogs.run_length(state.tracking_ticks, strayed)
    if state.tracking_ticks >= watchdogs.TRACKING_TICKS:
        fire(state, Event.LATCH, Reason.TORQUE_TRACKING, now_ms)
    if abs(inputs.velocity_mdeg_s) > limits.speed_limit_mdeg_s:
        fire(state, Event.LATCH, Reason.JOINT_SPEED, now_ms)
    if not limits.angle_low_mdeg <= inputs.angle_mdeg <= limits.angle_high_mdeg:
        fire(state, Event.LATCH, Reason.RANGE_OF_MOTION, now_ms)


def _deadlines(state: ControllerState, inputs: Inputs, now_ms: int) -> None:
    """Everything that happens because time went by."""
    if state.state == State.BOOT:
        fire(state, Event.BOOTED, Reason.NONE, now_ms)
    elif state.state == State.SELFTEST and watchdogs.expired(state.self_test_ms, now_ms, SELF_TEST_MS):
        if inputs.self_test_ok and passed():
            fire(state, Event.SELFTEST_PASSED, Reason.NONE, now_ms)
        else:
            fire(state, Event.LATCH, Reason.SELF_TEST_FAILED, now_ms)
    if state.pending is not None and not watchdogs.fresh(state.pending.arrived_ms, now_ms, watchdogs.AUTH_LIMIT_MS):
        authorisation_missing(state, now_ms)
    if state.command_live and watchdogs.expired(state.command_ms, now_ms, watchdogs.COMMAND_LIMIT_MS):
        command_overdue(state, now_ms)
    if state.armed and watchdogs.expired(state.heartbeat_ms, now_ms, watchdogs.HEARTBEAT_LIMIT_MS):
        disarm(state)
        trip(state, Reason.HEARTBEAT_TIMEOUT, now_ms)
    if state.state == State.ASSIST and watchdogs.expired(state.assist_since_ms, now_ms, watchdogs.DWELL_LIMIT_MS):
        fire(state, Event.FAULT, Reason.ASSIST_DWELL, now_ms)
    if inputs.local_clear and _may_clear(state, now_ms):
        state.trips = ()
        state.bus_offs = ()
        state.mac_failures = 0
        state.clear_until_ms = 0
        fire(state, Event.CLEAR, Reason.CLEARED, now_ms)


def _may_clear(state: ControllerState, now_ms: int) -> bool:
    """Zero torque, HOLD present and an authenticated challenge; the local action is the caller's."""
    at_rest = state.torque.assist_unm == 0 and state.torque.gravity_unm == 0
    held = state.command_live and state.command_is_hold
    return at_rest and held and now_ms < state.clear_until_ms


def _torque(state: ControllerState, inputs: Inputs, now_ms: int) -> None:
    """The torque law of the state; and the end of a ramp, which is an event."""
    used = profile(state.verb) if state.state == State.ASSIST else NONE
    state.torque = torque.track(state.torque, used, inputs.velocity_mdeg_s)
    if state.state == State.ASSIST:
        state.torque = torque.assisting(
            state.torque, used, inputs.angle_mdeg, inputs.velocity_mdeg_s, inputs.user_torque_unm
        )
    elif state.state == State.PASSIVE:
        state.torque = torque.at_rest(state.torque)
    elif state.state == State.ESTOP:
        state.torque = torque.support_gone(torque.ramping(state.torque, torque.STOP_STRIDE))
    elif state.implausible_ticks >= watchdogs.IMPLAUSIBLE_TICKS:
        state.torque = torque.support_gone(torque.ramping(state.torque, 1))
    else:
        state.torque = torque.supporting_less(torque.ramping(state.torque, 1))
    if state.state == State.RAMP_DOWN and state.torque.assist_unm == 0:
        done = Event.RAMPED_FAULT if state.ramp_fault else Event.RAMPED_CLEAN
        fire(state, done, state.reason, now_ms)
