"""AUTOSAR E2E profile 5 and its state machine on the bridge (Foundation R20-11, PRS_E2EProtocol), driven by the DBC.

Frame: CRC-16/CCITT-FALSE little endian in bytes 0-1, counter in byte 2. The CRC covers bytes 2.. and the 16-bit Data
ID, low byte first. The device has its own implementation; tests hold the two and an outside library together.
"""

from __future__ import annotations

from binascii import crc_hqx
from enum import StrEnum
from typing import NamedTuple

WINDOW = 4
MIN_OK_INIT = 2
MAX_ERROR_INIT = 1
MIN_OK_VALID = 1
MAX_ERROR_VALID = 1
MIN_OK_INVALID = 2
MAX_ERROR_INVALID = 0


class CheckStatus(StrEnum):
    """Result of one profile check."""

    OK = "ok"
    SOME_LOST = "some_lost"
    REPEATED = "repeated"
    WRONG_SEQUENCE = "wrong_sequence"
    ERROR = "error"
    NO_NEW_DATA = "no_new_data"


class MachineState(StrEnum):
    """State of the E2E state machine of one message."""

    NO_DATA = "no_data"
    INIT = "init"
    VALID = "valid"
    INVALID = "invalid"


class ReceiverState(NamedTuple):
    """What is remembered of one received message; `lost` counts gaps in its counter."""

    counter: int | None = None
    machine: MachineState = MachineState.NO_DATA
    window: tuple[CheckStatus, ...] = ()
    lost: int = 0


# What every frame of a sound bus finds and leaves: constants, since it is asked for so often.
_OK = CheckStatus.OK
_VALID = MachineState.VALID
_ALL_OK = (CheckStatus.OK,) * WINDOW


def crc(data: bytes, data_id: int) -> int:
    """CRC of a frame's bytes from the counter on."""
    return crc_hqx(data[2:] + data_id.to_bytes(2, "little"), 0xFFFF)


def protect(data: bytes, data_id: int, counter: int) -> bytes:
    """The frame with counter (modulo 256) and CRC filled in."""
    body = b"\0\0" + bytes((counter & 0xFF,)) + data[3:]
    return crc(body, data_id).to_bytes(2, "little") + body[2:]


def check(data: bytes, data_id: int, max_delta: int, state: ReceiverState) -> tuple[CheckStatus, ReceiverState]:
    """Check one frame and advance its machine. A frame in error leaves the counter where it was. Never raises."""
    if len(data) < 3 or crc(data, data_id) != int.from_bytes(data[:2], "little"):
        return CheckStatus.ERROR, advance(state, CheckStatus.ERROR)
    counter = data[2]
    lost = 0
    status = _OK
    if state.counter is not None:
        delta = (counter - state.counter) % 256
        if delta == 0:
            status = CheckStatus.REPEATED
        elif delta > max_delta:
            status = CheckStatus.WRONG_SEQUENCE
        elif delta > 1:
            status = CheckStatus.SOME_LOST
            lost = delta - 1
    moved = ReceiverState(counter, state.machine, state.window, state.lost + lost)
    return status, advance(moved, status)


def advance(state: ReceiverState, status: CheckStatus) -> ReceiverState:
    """One step of the state machine; NO_NEW_DATA stands for a message that is overdue."""
    if status is _OK and state.machine is _VALID and state.window == _ALL_OK:
        return state
    if state.machine is MachineState.NO_DATA:
        if status in (CheckStatus.ERROR, CheckStatus.NO_NEW_DATA):
            return state
        return ReceiverState(state.counter, MachineState.INIT, (status,), state.lost)
    window = (*state.window, status)[-WINDOW:]
    good = sum(entry in (CheckStatus.OK, CheckStatus.SOME_LOST) for entry in window)
    errors = window.count(CheckStatus.ERROR)
    machine = state.machine
    if machine is MachineState.INIT:
        if errors > MAX_ERROR_INIT:
            machine = MachineState.INVALID
        elif good >= MIN_OK_INIT:
            machine = MachineState.VALID
    elif machine is MachineState.VALID:
        if errors > MAX_ERROR_VALID or good < MIN_OK_VALID:
            machine = MachineState.INVALID
    elif errors <= MAX_ERROR_INVALID and good >= MIN_OK_INVALID:
        machine = MachineState.VALID
    return ReceiverState(state.counter, machine, window, state.lost)
