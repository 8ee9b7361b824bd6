"""Frames the controller sends: cyclic, on a change of state, on trips. Each is E2E profile 5 with its own counter."""

from __future__ import annotations

from firmware_sim import e2e, frames
from firmware_sim.law.numbers import clamp, div
from firmware_sim.memory import (
    COUNT_TX_DROPPED,
    COUNTERS,
    ECHO_SLOTS,
    OUTBOX_SLOTS,
    ControllerState,
    Inputs,
    count,
)
from firmware_sim.states import Reason, State

STATUS_CYCLE_MS = 20
MEAS_CYCLE_MS = 20
HEARTBEAT_CYCLE_MS = 100
DIAG_CYCLE_MS = 34  # 29 counters, each within the second
ANGLE_OFFSET_MDEG = 30_000


def send(state: ControllerState, can_id: int, values: tuple[int, ...]) -> int:
    """Put a protected frame into the outbox; returns its E2E counter. What does not fit is dropped and counted."""
    slot = frames.OWN_IDS.index(can_id)
    counter = (state.tx_counters[slot] + 1) & 0xFF
    state.tx_counters = (*state.tx_counters[:slot], counter, *state.tx_counters[slot + 1 :])
    if len(state.outbox) < OUTBOX_SLOTS:
        data = e2e.protect(can_id, frames.pack(can_id, values), counter)
        state.outbox = (*state.outbox, (can_id, data))
    else:
        count(state, COUNT_TX_DROPPED)
    return counter


def emergency(state: ControllerState, reason: Reason) -> None:
    """CTRL_EMCY for a trip, a latch or a stop."""
    state.emergencies += 1
    latched = int(state.state in (State.LATCHED, State.ESTOP))
    send(state, frames.CTRL_EMCY, (int(reason), int(state.state), latched, state.emergencies & 0xFF))


def send_status(state: ControllerState, now_ms: int) -> None:
    """CTRL_STATUS; its counter is what the bridge has to echo, so the time of sending is remembered."""
    assisting = state.state == State.ASSIST
    values = (
        int(state.state),
        int(state.reason),
        state.verb if assisting else frames.VERB_NONE,
        max(0, state.torque.authority) // 10 if assisting else 0,
        state.accepted_counter,
        state.session,
        int(state.armed),
        int(state.torque.assist_unm == 0),
    )
    counter = send(state, frames.CTRL_STATUS, values)
    state.echoes = (*state.echoes, (counter, now_ms))[-ECHO_SLOTS:]
    state.status_due_ms = now_ms + STATUS_CYCLE_MS


def _measurement(state: ControllerState, inputs: Inputs) -> tuple[int, ...]:
    angle = div(inputs.angle_mdeg + ANGLE_OFFSET_MDEG, 250)
    return (
        0,
        min(max(angle, 0), 1023),
        clamp(div(inputs.velocity_mdeg_s, 2000), 511),
        clamp(div(state.torque.assist_unm, 20_000), 127),
        clamp(div(state.torque.gravity_unm, 50_000), 127),
    )


def send_cyclic(state: ControllerState, inputs: Inputs, changed: bool, now_ms: int) -> None:
    """Whatever is due in this tick; the status also at once when the state has changed."""
    if changed or now_ms >= state.status_due_ms:
        send_status(state, now_ms)
    if now_ms >= state.meas_due_ms:
        send(state, frames.CTRL_MEAS, _measurement(state, inputs))
        state.meas_due_ms = now_ms + MEAS_CYCLE_MS
    if now_ms >= state.heartbeat_due_ms:
        send(state, frames.CTRL_HB, (frames.PROTOCOL_VERSION, state.boot_nonce))
        state.heartbeat_due_ms = now_ms + HEARTBEAT_CYCLE_MS
    if now_ms >= state.diag_due_ms:
        send(state, frames.CTRL_DIAG, (state.diag_index, state.counters[state.diag_index]))
        state.diag_index = (state.diag_index + 1) % COUNTERS
        state.diag_due_ms = now_ms + DIAG_CYCLE_MS
