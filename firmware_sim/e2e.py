"""AUTOSAR E2E profile 5 and the E2E state machine, on the device (Foundation R20-11, PRS_E2EProtocol).

Frame: CRC-16 (0x1021, start 0xFFFF) little endian in bytes 0-1, counter in byte 2, payload in bytes 3-7. The CRC covers
bytes 2-7 and then the 16-bit Data ID, low byte first, which is never sent.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from firmware_sim import frames

# Data ID, largest counter step that still counts as "some lost" (255 for events, which may go unsent for long).
DATA_ID: dict[int, int] = {
    frames.CTRL_EMCY: 0x1020,
    frames.ACT_CMD: 0x1060,
    frames.ACT_AUTH: 0x1061,
    frames.CTRL_STATUS: 0x10A0,
    frames.CTRL_MEAS: 0x10A1,
    frames.BRIDGE_HB: 0x1120,
    frames.CTRL_HB: 0x1121,
    frames.ARM_REQUEST: 0x1180,
    frames.ARM_CHALLENGE: 0x1181,
    frames.ARM_RESPONSE: 0x1182,
    frames.BRIDGE_DIAG: 0x1300,
    frames.CTRL_DIAG: 0x1301,
}
MAX_DELTA: dict[int, int] = {
    frames.ACT_CMD: 3,
    frames.ACT_AUTH: 255,
    frames.BRIDGE_HB: 3,
    frames.ARM_REQUEST: 255,
    frames.ARM_RESPONSE: 255,
    frames.BRIDGE_DIAG: 255,
}

WINDOW = 4
MIN_OK_INIT = 2
MAX_ERROR_INIT = 1
MIN_OK_VALID = 1
MAX_ERROR_VALID = 1
MIN_OK_INVALID = 2
MAX_ERROR_INVALID = 0


class Check(IntEnum):
    """Result of one profile check (E2E_PCheckStatusType)."""

    OK = 0
    ERROR = 1
    REPEATED = 2
    NO_NEW_DATA = 3
    OK_SOME_LOST = 4
    WRONG_SEQUENCE = 5


class Machine(IntEnum):
    """State of the E2E state machine (E2E_SMStateType)."""

    NO_DATA = 0
    INIT = 1
    VALID = 2
    INVALID = 3


# By themselves, for what asks with every frame.
OK, ERROR, REPEATED, NO_NEW_DATA, OK_SOME_LOST, WRONG_SEQUENCE = Check
NO_DATA, INIT, VALID, INVALID = Machine


class Receiver(NamedTuple):
    """What is remembered of one received message: last counter (None: none yet), machine, last checks, frames lost."""

    counter: int | None = None
    machine: Machine = Machine.NO_DATA
    window: tuple[Check, ...] = ()
    lost: int = 0


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1
        table.append(crc & 0xFFFF)
    return tuple(table)


CRC_TABLE = _crc_table()


def crc16(data: bytes, start: int = 0xFFFF) -> int:
    """CRC-16/CCITT-FALSE over `data`; crc16(b"123456789") is 0x29B1 (AUTOSAR SWS_CRCLibrary)."""
    crc = start
    for byte in data:
        crc = ((crc << 8) & 0xFFFF) ^ CRC_TABLE[(crc >> 8) ^ byte]
    return crc


_TAIL = {can_id: data_id.to_bytes(2, "little") for can_id, data_id in DATA_ID.items()}


def frame_crc(can_id: int, data: bytes) -> int:
    """CRC that belongs into bytes 0-1 of this frame."""
    return crc16(data[2:] + _TAIL[can_id])


def protect(can_id: int, data: bytes, counter: int) -> bytes:
    """The frame with counter (modulo 256) and CRC filled in; bytes 3-7 are taken from `data`."""
    body = bytes((counter & 0xFF,)) + data[3:]
    crc = crc16(body + _TAIL[can_id])
    return bytes((crc & 0xFF, crc >> 8)) + body


def check(can_id: int, data: bytes, receiver: Receiver) -> tuple[Check, Receiver]:
    """Profile check and one step of the state machine for a frame of eight bytes. A frame in error moves no counter."""
    if frame_crc(can_id, data) != data[0] | data[1] << 8:
        return ERROR, advance(receiver, ERROR)
    counter = data[2]
    lost = receiver.lost
    if receiver.counter is None:
        result = OK
    else:
        delta = (counter - receiver.counter) & 0xFF
        if delta == 0:
            result = REPEATED
        elif delta == 1:
            result = OK
        elif delta <= MAX_DELTA[can_id]:
            result = OK_SOME_LOST
            lost += delta - 1
        else:
            result = WRONG_SEQUENCE
    return result, advance(Receiver(counter, receiver.machine, receiver.window, lost), result)


def advance(receiver: Receiver, result: Check) -> Receiver:
    """One step of the E2E state machine; NO_NEW_DATA is the step for a message that is overdue."""
    if receiver.machine is NO_DATA:
        if result in (ERROR, NO_NEW_DATA):
            return receiver
        return receiver._replace(machine=INIT, window=(result,))
    window = (*receiver.window, result)[-WINDOW:]
    good = window.count(OK) + window.count(OK_SOME_LOST)
    errors = window.count(ERROR)
    machine = receiver.machine
    if machine is INIT:
        if errors > MAX_ERROR_INIT:
            machine = INVALID
        elif good >= MIN_OK_INIT:
            machine = VALID
    elif machine is VALID:
        if errors > MAX_ERROR_VALID or good < MIN_OK_VALID:
            machine = INVALID
    elif errors <= MAX_ERROR_INVALID and good >= MIN_OK_INVALID:
        machine = VALID
    return Receiver(receiver.counter, machine, window, receiver.lost)


def overdue(receiver: Receiver) -> Receiver:
    """The message missed its deadline: trust has to be earned again, by MIN_OK_INVALID good frames."""
    if receiver.machine is NO_DATA:
        return receiver
    return receiver._replace(machine=INVALID, window=(NO_NEW_DATA,) * WINDOW)
