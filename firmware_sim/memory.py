"""What the controller remembers, reads and puts out: three plain structures, as a C port would declare them.

`ControllerState` is written to in place, field by field; the values in it are immutable, all but the torque law's memory,
which is copied with it. Integers throughout: ms of the device's own clock, mdeg, mdeg/s, uN m.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

from firmware_sim.e2e import Receiver
from firmware_sim.frames import OWN_IDS, RECEIVED_IDS, VERB_NONE, Reject
from firmware_sim.law.memory import Torque
from firmware_sim.profiles import Profiles, shipped
from firmware_sim.states import Reason, State
from firmware_sim.watchdogs import Limits

# Indices into ControllerState.counters (CTRL_DIAG); 0..20 are frames.Reject.
COUNT_TRIPS = 21
COUNT_MAC_FAILURES = 22
COUNT_STALL_TICKS = 23
COUNT_TX_DROPPED = 24
COUNT_BUS_OFFS = 25
ECHO_AGE_MAX_MS = 26
COUNT_LOST = 27
COUNT_OWN_ID = 28
COUNTERS = 29
ECHO_SLOTS = 16
COMMAND_SLOTS = 5
OUTBOX_SLOTS = 32  # three times what a bus of 1 Mbit/s carries within a tick


class Refusal(IntEnum):
    """Why the last handshake came to nothing; NONE where it led to a session."""

    NONE = 0
    KEY = 1
    DISTURBED = 2
    LATE = 3


class Received(NamedTuple):
    """A frame of this tick. `plain` is False for an error, remote, extended or FD frame."""

    can_id: int
    data: bytes
    plain: bool = True


@dataclass(slots=True)
class Inputs:
    """Everything the controller sees in one tick; it only reads them.

    `random_u32` must be unpredictable: it becomes a nonce. `local_clear` is somebody's own hand on the device.
    `stall_ticks` and `tx_dropped` are new counts of the node since the last tick, only for DIAG.
    """

    frames: tuple[Received, ...] = ()
    angle_mdeg: int = 30_000
    second_angle_mdeg: int = 30_000
    velocity_mdeg_s: int = 0
    user_torque_unm: int = 0
    measured_unm: int = 0
    commanded_unm: int = 0
    random_u32: int = 0
    bus_off: bool = False
    self_test_ok: bool = True
    local_clear: bool = False
    stall_ticks: int = 0
    tx_dropped: int = 0


class Command(NamedTuple):
    """An ACT_CMD with a right CRC, as it came; `waited` is whether it was an ACT that waited for its ACT_AUTH."""

    arrived_ms: int
    data: bytes
    waited: bool = False


class PendingAct(NamedTuple):
    """An ACT_CMD that passed every plain check and waits for its ACT_AUTH."""

    arrived_ms: int
    data: bytes
    verb: int
    counter: int


class Challenge(NamedTuple):
    """An ARM_CHALLENGE that waits for its ARM_RESPONSE."""

    sent_ms: int
    purpose: int
    session: int
    bridge_nonce: int
    device_nonce: int
    disturbed: bool = False  # more than one asked


@dataclass(slots=True)
class ControllerState:
    """All memory of the controller. The default, with a key and a boot nonce, is power-on."""

    shared_key: bytes = field(repr=False)
    boot_nonce: int
    limits: Limits = field(default_factory=Limits)
    profiles: Profiles = field(default_factory=shipped, repr=False)
    last_tick_ms: int = 0
    state: State = State.BOOT
    reason: Reason = Reason.NONE
    torque: Torque = field(default_factory=Torque)
    ramp_fault: bool = False
    verb: int = VERB_NONE
    assist_since_ms: int = 0
    self_test_ms: int = 0
    # commands
    receivers: tuple[Receiver, ...] = (Receiver(),) * len(RECEIVED_IDS)
    pending: PendingAct | None = None
    commands: tuple[Command, ...] = ()  # the last ones, refused ones too
    command_live: bool = False
    command_ms: int = 0
    command_is_hold: bool = False
    accepted_counter: int = 0
    neutral: int = 0
    echoes: tuple[tuple[int, int], ...] = ()  # (counter, sent ms) of the last CTRL_STATUS frames
    # session
    armed: bool = False
    session: int = 0
    key: bytes = field(default=b"", repr=False)
    freshness: int = 0
    mac_checked: bool = False  # in this tick, which has time for one
    heartbeat_ms: int = 0
    challenge: Challenge | None = None
    last_session: int = 0
    handshake_rest_ms: int = 0  # until then no request is answered
    refusal: Refusal = Refusal.NONE
    clear_until_ms: int = 0
    # faults
    trips: tuple[int, ...] = ()
    bus_offs: tuple[int, ...] = ()
    was_bus_off: bool = False
    mac_failures: int = 0
    tracking_doubt: int = 0
    sensor_doubt: int = 0
    healthy_ticks: int = 0
    previous_mdeg: int | None = None
    previous_user_unm: int = 0
    # transmission
    counters: tuple[int, ...] = (0,) * COUNTERS
    tx_counters: tuple[int, ...] = (0,) * len(OWN_IDS)
    outbox: tuple[tuple[int, bytes], ...] = ()  # of this tick
    status_due_ms: int = 0
    meas_due_ms: int = 10
    heartbeat_due_ms: int = 5
    diag_due_ms: int = 15
    diag_index: int = 0
    emergencies: int = 0
    follow_unm: int = 0  # of this tick


def count(state: ControllerState, index: int, amount: int = 1) -> None:
    """Add to one DIAG counter; they stop at 32 bits and never wrap."""
    counters = list(state.counters)
    counters[index] = min(counters[index] + amount, 0xFFFFFFFF)
    state.counters = tuple(counters)


def reject(state: ControllerState, why: Reject) -> None:
    """Count a received frame under its reason (ACCEPTED included)."""
    count(state, why)
