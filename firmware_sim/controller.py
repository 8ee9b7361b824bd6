"""The controller's 1 kHz step, `advance`: state, inputs and the time change the state. No clock, no bus, no I/O, integers only.

Order within a tick: device faults, frames in the order of their arrival, deadlines, torque, transmission. So a command
can never outrun a fault of the same tick, and what is sent describes the tick's end. Nearly all ticks bring no frame and
end no deadline; what is asked in every one is asked by plain comparison.
"""

from __future__ import annotations

from firmware_sim import torque, watchdogs
from firmware_sim.law.filters import track
from firmware_sim.law.support import support_gone
from firmware_sim.memory import (
    COUNT_BUS_OFFS,
    COUNT_STALL_TICKS,
    COUNT_TX_DROPPED,
    ControllerState,
    Inputs,
    count,
)
from firmware_sim.receive import authorisation_missing, receive
from firmware_sim.selftest import passed
from firmware_sim.states import ASSIST, BOOT, ESTOP, PASSIVE, RAMP_DOWN, SELFTEST, Event, Reason
from firmware_sim.transitions import SELF_TEST_MS, bus_off, command_overdue, disarm, fire, trip
from firmware_sim.transmit import send_cyclic

_NO_FOLLOW = frozenset({BOOT, SELFTEST, PASSIVE})
_PLANT_FAULTS = frozenset({Reason.TORQUE_TRACKING, Reason.JOINT_SPEED, Reason.RANGE_OF_MOTION})


def advance(state: ControllerState, inputs: Inputs, now_ms: int) -> None:
    """One tick, in place; frames to send and the parts of torque are to be found in the state then.

    `now_ms` is the device's own time and grows by one per tick; a gap of 5 ms or more latches. Never raises on anything
    that comes from the bus.
    """
    began = state.state
    state.outbox = ()
    state.mac_checked = False
    _device_faults(state, inputs, now_ms)
    for frame in inputs.frames:
        receive(state, frame, inputs.random_u32, now_ms)
    _deadlines(state, inputs, now_ms)
    _torque(state, inputs, now_ms)
    send_cyclic(state, inputs, state.state is not began, now_ms)
    state.last_tick_ms = now_ms
    sensors_lost = state.state in _NO_FOLLOW or state.sensor_doubt >= watchdogs.SENSOR_DOUBT
    if sensors_lost or state.reason in _PLANT_FAULTS:  # which are reasons of a latch alone
        state.follow_unm = 0
    else:
        state.follow_unm = torque.follow_torque(inputs.angle_mdeg, inputs.velocity_mdeg_s)


def _device_faults(state: ControllerState, inputs: Inputs, now_ms: int) -> None:
    """What the device can tell about itself: its tick, its transceiver, its sensors, its actuator, its arm."""
    if inputs.stall_ticks:
        count(state, COUNT_STALL_TICKS, inputs.stall_ticks)
    if inputs.tx_dropped:
        count(state, COUNT_TX_DROPPED, inputs.tx_dropped)
    if now_ms - state.last_tick_ms >= watchdogs.TICK_LIMIT_MS and state.last_tick_ms:
        fire(state, Event.LATCH, Reason.TICK_OVERRUN, now_ms)
    if inputs.bus_off and not state.was_bus_off:
        count(state, COUNT_BUS_OFFS)
        bus_off(state, now_ms)
    state.was_bus_off = inputs.bus_off
    if _sensors_bad(state, inputs):
        state.healthy_ticks = 0
        if state.sensor_doubt >= watchdogs.SENSOR_DOUBT:
            disarm(state)
            fire(state, Event.SENSORS_BAD, Reason.SENSOR_IMPLAUSIBLE, now_ms)
        return
    state.healthy_ticks += 1
    if state.state is PASSIVE and state.healthy_ticks >= watchdogs.HEALTHY_TICKS:
        fire(state, Event.SENSORS_GOOD, Reason.SENSOR_IMPLAUSIBLE, now_ms)
    limits = state.limits
    astray = abs(inputs.commanded_unm - inputs.measured_unm) > limits.tracking_limit_unm
    if astray or state.tracking_doubt:
        state.tracking_doubt = watchdogs.leaked(
            state.tracking_doubt, astray, watchdogs.TRACKING_RISE, watchdogs.TRACKING_DOUBT
        )
        if state.tracking_doubt >= watchdogs.TRACKING_DOUBT:
            fire(state, Event.LATCH, Reason.TORQUE_TRACKING, now_ms)
    if abs(inputs.velocity_mdeg_s) > limits.speed_limit_mdeg_s:
        fire(state, Event.LATCH, Reason.JOINT_SPEED, now_ms)
    if not limits.angle_low_mdeg <= inputs.angle_mdeg <= limits.angle_high_mdeg:
        fire(state, Event.LATCH, Reason.RANGE_OF_MOTION, now_ms)


def _sensors_bad(state: ControllerState, inputs: Inputs) -> bool:
    """Whether this tick's readings cannot be true; the doubt that such ticks leave leaks away slowly."""
    angle, user = inputs.angle_mdeg, inputs.user_torque_unm
    previous = angle if state.previous_mdeg is None else state.previous_mdeg
    bad = watchdogs.implausible(
        angle, inputs.second_angle_mdeg, previous, inputs.velocity_mdeg_s
    ) or watchdogs.impossible(user, state.previous_user_unm)
    state.previous_mdeg, state.previous_user_unm = angle, user
    if bad or state.sensor_doubt:
        state.sensor_doubt = watchdogs.leaked(state.sensor_doubt, bad, watchdogs.SENSOR_RISE, watchdogs.SENSOR_DOUBT)
    return bad


def _deadlines(state: ControllerState, inputs: Inputs, now_ms: int) -> None:
    """Everything that happens because time went by."""
    if state.state is BOOT:
        fire(state, Event.BOOTED, Reason.NONE, now_ms)
    elif state.state is SELFTEST and watchdogs.expired(state.self_test_ms, now_ms, SELF_TEST_MS):
        if inputs.self_test_ok and passed():
            fire(state, Event.SELFTEST_PASSED, Reason.NONE, now_ms)
        else:
            fire(state, Event.LATCH, Reason.SELF_TEST_FAILED, now_ms)
    if state.pending is not None and not watchdogs.fresh(state.pending.arrived_ms, now_ms, watchdogs.AUTH_LIMIT_MS):
        authorisation_missing(state, now_ms)
    if state.command_live and now_ms - state.command_ms >= watchdogs.COMMAND_LIMIT_MS:
        command_overdue(state, now_ms)
    if state.armed and now_ms - state.heartbeat_ms >= watchdogs.HEARTBEAT_LIMIT_MS:
        disarm(state)
        trip(state, Reason.HEARTBEAT_TIMEOUT, now_ms)
    if state.state is ASSIST and watchdogs.expired(state.assist_since_ms, now_ms, watchdogs.DWELL_LIMIT_MS):
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
    law, current, velocity = state.torque, state.state, inputs.velocity_mdeg_s
    track(law, velocity, inputs.user_torque_unm)
    if current is ASSIST:
        torque.assisting(law, state.profiles.of(state.verb), inputs.angle_mdeg, velocity)
    elif current is PASSIVE:
        torque.at_rest(law)
    elif current is ESTOP:
        torque.ramping(law, torque.STOP_STRIDE, velocity)
        support_gone(law)
    elif state.sensor_doubt >= watchdogs.SENSOR_DOUBT:
        torque.ramping(law, 1, velocity)
        support_gone(law)
    else:
        torque.letting_go(law, velocity)
    if current is RAMP_DOWN and law.assist_unm == 0:
        done = Event.RAMPED_FAULT if state.ramp_fault else Event.RAMPED_CLEAN
        fire(state, done, state.reason, now_ms)
