"""How events change the controller: the table, and what has to happen on the way into a state."""

from __future__ import annotations

from firmware_sim import e2e, frames, watchdogs
from firmware_sim.memory import COUNT_MAC_FAILURES, COUNT_TRIPS, ControllerState, count
from firmware_sim.states import ASSIST, ESTOP, FOLLOW, LATCHED, RAMP_DOWN, READY, SELFTEST, Event, Reason, next_state
from firmware_sim.transmit import emergency

SELF_TEST_MS = 50
_STOPPED = (LATCHED, ESTOP)


def fire(state: ControllerState, event: Event, reason: Reason, now_ms: int) -> None:
    """Apply one event to the one table, and enter the new state."""
    before = state.state
    target = next_state(before, event)
    if before is RAMP_DOWN and event is Event.FAULT:
        state.ramp_fault = True  # on its way to READY; now it is not
        state.reason = reason
    if target is before:
        return
    state.state = target
    state.reason = reason
    if target is SELFTEST:
        state.self_test_ms = now_ms
    elif target is FOLLOW:
        state.neutral = 0
    elif target is ASSIST:
        state.assist_since_ms = now_ms
    elif target is RAMP_DOWN:
        state.ramp_fault = event is Event.FAULT
    elif target in _STOPPED:
        disarm(state)
        emergency(state, reason)


def disarm(state: ControllerState) -> None:
    """Forget the session: its key, its number and whatever waited for it."""
    state.armed = False
    state.session = 0
    state.key = b""
    state.freshness = 0
    state.pending = None
    state.neutral = 0


def trip(state: ControllerState, reason: Reason, now_ms: int) -> None:
    """A watchdog on the command path expired. Three that mattered within 60 s latch; one recovers alone."""
    matters = state.state in (READY, ASSIST) or (state.state is RAMP_DOWN and not state.ramp_fault)
    fire(state, Event.FAULT, reason, now_ms)
    if not matters:
        return
    count(state, COUNT_TRIPS)
    emergency(state, reason)
    state.trips = watchdogs.remember(state.trips, now_ms, watchdogs.TRIP_LIMIT)
    if watchdogs.crowded(state.trips, now_ms, watchdogs.TRIP_LIMIT, watchdogs.TRIP_WINDOW_MS):
        fire(state, Event.LATCH, Reason.REPEATED_TRIPS, now_ms)


def mac_failed(state: ControllerState, now_ms: int) -> None:
    """Somebody does not know the key. Counted from boot or the last clearing; the third latches."""
    state.mac_failures += 1
    count(state, COUNT_MAC_FAILURES)
    if state.mac_failures >= watchdogs.MAC_FAILURE_LIMIT:
        fire(state, Event.LATCH, Reason.MAC_FAILURES, now_ms)


def bus_off(state: ControllerState, now_ms: int) -> None:
    """The device's own transceiver left the bus: the session is gone; a second time in 10 s latches."""
    state.bus_offs = watchdogs.remember(state.bus_offs, now_ms, watchdogs.BUS_OFF_LIMIT)
    disarm(state)
    fire(state, Event.FAULT, Reason.BUS_OFF, now_ms)
    if watchdogs.crowded(state.bus_offs, now_ms, watchdogs.BUS_OFF_LIMIT, watchdogs.BUS_OFF_WINDOW_MS):
        fire(state, Event.LATCH, Reason.REPEATED_BUS_OFF, now_ms)


def command_overdue(state: ControllerState, now_ms: int) -> None:
    """No accepted ACT_CMD for 100 ms: its E2E machine has to earn trust again, and so has the sender.

    The session ends too: whatever was made before the silence and arrives after it is worthless, even where its 8-bit
    echo has wrapped around to a fresh one (docs/decisions/104).
    """
    slot = frames.RECEIVED_IDS.index(frames.ACT_CMD)
    state.command_live = False
    disarm(state)
    state.receivers = (
        *state.receivers[:slot],
        e2e.overdue(state.receivers[slot]),
        *state.receivers[slot + 1 :],
    )
    trip(state, Reason.COMMAND_TIMEOUT, now_ms)
