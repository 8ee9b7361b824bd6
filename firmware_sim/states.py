"""The controller's states, events and its one total transition table. Default deny: what is not listed changes nothing.

`python -m firmware_sim.diagram` prints the diagram of docs/controller-states.md; a test compares the two and walks the
whole product of states and events.
"""

from __future__ import annotations

from enum import IntEnum


class State(IntEnum):
    """As on the wire (CTRL_STATUS.State)."""

    BOOT = 0
    SELFTEST = 1
    FOLLOW = 2
    READY = 3
    ASSIST = 4
    RAMP_DOWN = 5
    PASSIVE = 6
    LATCHED = 7
    ESTOP = 8


# By themselves, for what asks every millisecond: finding one in its class costs six times the comparison.
BOOT, SELFTEST, FOLLOW, READY, ASSIST, RAMP_DOWN, PASSIVE, LATCHED, ESTOP = State


class Event(IntEnum):
    """What can happen to the controller within a tick."""

    BOOTED = 0
    SELFTEST_PASSED = 1
    NEUTRAL = 2  # armed, E2E VALID, three HOLDs in a row
    ACT = 3  # an authorised ACT for the verb being assisted, or for any verb when none is
    VERB_CHANGE = 4  # an authorised ACT for another verb than the one being assisted
    HOLD = 5  # an accepted HOLD, or an ACT that counts as one
    FAULT = 6  # a command or its sender is not to be trusted: time-out, E2E, disarmed, bus-off, dwell
    RAMPED_CLEAN = 7  # assist is exactly zero, after a HOLD or a change of verb
    RAMPED_FAULT = 8  # assist is exactly zero, after a fault
    SENSORS_BAD = 9
    SENSORS_GOOD = 10
    LATCH = 11
    STOP = 12
    CLEAR = 13  # zero torque, HOLD present, authenticated challenge and a local action


class Reason(IntEnum):
    """Why the controller is where it is, as on the wire (CTRL_STATUS.Reason, CTRL_EMCY.Code)."""

    NONE = 0
    HOLD = 1
    VERB_CHANGE = 2
    COMMAND_TIMEOUT = 3
    E2E_INVALID = 4
    AUTH_MISSING = 5
    ECHO_STALE = 6
    SENSING_STALE = 7
    HEARTBEAT_TIMEOUT = 8
    ASSIST_DWELL = 9
    BUS_OFF = 10
    NOT_ARMED = 11
    DISARMED = 12
    SENSOR_IMPLAUSIBLE = 13
    STOP_RECEIVED = 14
    TICK_OVERRUN = 15
    TORQUE_TRACKING = 16
    JOINT_SPEED = 17
    RANGE_OF_MOTION = 18
    REPEATED_TRIPS = 19
    MAC_FAILURES = 20
    REPEATED_BUS_OFF = 21
    OWN_ID_SEEN = 22
    SELF_TEST_FAILED = 23
    VERB_UNASSISTED = 24
    CLEARED = 25
    NEUTRAL = 26
    AUTHORISED = 27


_WRITTEN_OTHERWISE = {"SELFTEST": "SelfTest", "ESTOP": "EStop", "E2E_INVALID": "E2EInvalid"}


def wire_name(member: State | Reason) -> str:
    """The name that the DBC's value tables have for it, which logs and recordings use: RAMP_DOWN is RampDown."""
    return _WRITTEN_OTHERWISE.get(member.name) or "".join(word.capitalize() for word in member.name.split("_"))


_LISTED: dict[State, dict[Event, State]] = {
    State.BOOT: {Event.BOOTED: State.SELFTEST, Event.LATCH: State.LATCHED, Event.STOP: State.ESTOP},
    State.SELFTEST: {
        Event.SELFTEST_PASSED: State.FOLLOW,
        Event.SENSORS_BAD: State.PASSIVE,
        Event.LATCH: State.LATCHED,
        Event.STOP: State.ESTOP,
    },
    State.FOLLOW: {
        Event.NEUTRAL: State.READY,
        Event.SENSORS_BAD: State.PASSIVE,
        Event.LATCH: State.LATCHED,
        Event.STOP: State.ESTOP,
    },
    State.READY: {
        Event.ACT: State.ASSIST,
        Event.FAULT: State.FOLLOW,
        Event.SENSORS_BAD: State.PASSIVE,
        Event.LATCH: State.LATCHED,
        Event.STOP: State.ESTOP,
    },
    State.ASSIST: {
        Event.VERB_CHANGE: State.RAMP_DOWN,
        Event.HOLD: State.RAMP_DOWN,
        Event.FAULT: State.RAMP_DOWN,
        Event.SENSORS_BAD: State.PASSIVE,
        Event.LATCH: State.LATCHED,
        Event.STOP: State.ESTOP,
    },
    State.RAMP_DOWN: {
        Event.RAMPED_CLEAN: State.READY,
        Event.RAMPED_FAULT: State.FOLLOW,
        Event.SENSORS_BAD: State.PASSIVE,
        Event.LATCH: State.LATCHED,
        Event.STOP: State.ESTOP,
    },
    State.PASSIVE: {
        Event.SENSORS_GOOD: State.FOLLOW,
        Event.LATCH: State.LATCHED,
        Event.STOP: State.ESTOP,
    },
    State.LATCHED: {Event.CLEAR: State.SELFTEST, Event.STOP: State.ESTOP},
    State.ESTOP: {Event.CLEAR: State.SELFTEST},
}

TABLE: dict[State, dict[Event, State]] = {
    state: {event: listed.get(event, state) for event in Event} for state, listed in _LISTED.items()
}


def next_state(state: State, event: Event) -> State:
    """The one place where a state changes."""
    return TABLE[state][event]
