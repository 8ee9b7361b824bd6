"""The device's own bit codec: what the controller reads from and writes to the bus, by hand, as firmware would.

It does not read the DBC; tests/wire/test_conformance.py and dbc/golden_frames.json hold the two together. All values
are raw integers; a field is (name, first bit, bits, lowest, highest, allowed values or None), bits counted little
endian over the whole frame, so that payload starts at bit 24, after CRC and counter.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

STOP = 0x001
CTRL_EMCY = 0x020
ACT_CMD = 0x060
ACT_AUTH = 0x061
CTRL_STATUS = 0x0A0
CTRL_MEAS = 0x0A1
BRIDGE_HB = 0x120
CTRL_HB = 0x121
ARM_REQUEST = 0x180
ARM_CHALLENGE = 0x181
ARM_RESPONSE = 0x182
BRIDGE_DIAG = 0x300
CTRL_DIAG = 0x301

PROTOCOL_VERSION = 1
FRAME_LENGTH = 8
GATE_HOLD = 0b01
GATE_ACT = 0b10
PURPOSE_ARM = 1
PURPOSE_CLEAR_LATCH = 2
AGE_UNKNOWN = 255
VERB_NONE = 0
VERB_OTHER = 31
VERB_CODES = (*range(22), VERB_OTHER)
BRIDGE_DIAG_COUNT = 24


class Reject(IntEnum):
    """Why a received frame was dropped; the value is its index in CTRL_DIAG. ACCEPTED stands first."""

    ACCEPTED = 0
    LENGTH = 1
    RANGE = 2
    MUX = 3
    ENUM = 4
    RESERVED = 5
    UNKNOWN_ID = 6
    KIND = 7
    CRC = 8
    REPEATED = 9
    SEQUENCE = 10
    E2E_STATE = 11
    SESSION = 12
    NOT_ARMED = 13
    ECHO = 14
    AGE = 15
    VERB = 16
    AUTH_MISSING = 17
    AUTH_UNPAIRED = 18
    MAC = 19
    HANDSHAKE = 20


class Field(NamedTuple):
    """One signal: raw value = bits [start, start + bits) of the frame, two's complement where `lowest` < 0."""

    name: str
    start: int
    bits: int
    lowest: int
    highest: int
    allowed: tuple[int, ...] | None = None


_FLAG = (0, 1)
_STATES = tuple(range(9))
_REASONS = tuple(range(28))

FIELDS: dict[int, tuple[Field, ...]] = {
    CTRL_EMCY: (
        Field("Code", 24, 8, 0, 27, _REASONS),
        Field("State", 32, 4, 0, 8, _STATES),
        Field("Latched", 36, 1, 0, 1),
        Field("Count", 37, 8, 0, 255),
    ),
    ACT_CMD: (
        Field("Gate", 24, 2, 0, 3, (GATE_HOLD, GATE_ACT)),
        Field("Verb", 26, 5, 0, 31, VERB_CODES),
        Field("Confidence", 31, 7, 0, 100),
        Field("Session", 38, 8, 0, 255),
        Field("Echo", 46, 8, 0, 255),
        Field("SensingAge", 54, 8, 0, 255),
    ),
    ACT_AUTH: (Field("Freshness", 24, 8, 0, 255), Field("Mac", 32, 32, 0, 0xFFFFFFFF)),
    CTRL_STATUS: (
        Field("State", 24, 4, 0, 8, _STATES),
        Field("Reason", 28, 5, 0, 27, _REASONS),
        Field("AppliedVerb", 33, 5, 0, 31, VERB_CODES),
        Field("Authority", 38, 7, 0, 100),
        Field("AcceptedCounter", 45, 8, 0, 255),
        Field("Session", 53, 8, 0, 255),
        Field("Armed", 61, 1, 0, 1),
        Field("AssistZero", 62, 1, 0, 1),
    ),
    CTRL_MEAS: (
        Field("Joint", 24, 4, 0, 0),
        Field("Angle", 28, 10, 0, 1023),
        Field("Velocity", 38, 10, -512, 511),
        Field("AssistTorque", 48, 8, -128, 127),
        Field("GravityTorque", 56, 8, -128, 127),
    ),
    BRIDGE_HB: (
        Field("SensorValid", 24, 4, 0, 7),
        Field("BridgeState", 28, 4, 0, 4, tuple(range(5))),
        Field("Overruns", 32, 8, 0, 255),
        Field("BundleId", 40, 16, 0, 0xFFFF),
        Field("ProtocolVersion", 56, 8, 1, 255),
    ),
    CTRL_HB: (Field("ProtocolVersion", 24, 8, 1, 255), Field("BootNonce", 32, 32, 0, 0xFFFFFFFF)),
    ARM_REQUEST: (
        Field("BridgeNonce", 24, 32, 0, 0xFFFFFFFF),
        Field("Purpose", 56, 8, 0, 255, (PURPOSE_ARM, PURPOSE_CLEAR_LATCH)),
    ),
    ARM_CHALLENGE: (Field("DeviceNonce", 24, 32, 0, 0xFFFFFFFF), Field("Session", 56, 8, 1, 255)),
    ARM_RESPONSE: (Field("Mac", 24, 32, 0, 0xFFFFFFFF), Field("Session", 56, 8, 1, 255)),
    BRIDGE_DIAG: (Field("Index", 24, 8, 0, BRIDGE_DIAG_COUNT - 1), Field("Value", 32, 32, 0, 0xFFFFFFFF)),
    CTRL_DIAG: (Field("Index", 24, 8, 0, 28), Field("Value", 32, 32, 0, 0xFFFFFFFF)),
}

# A multiplexer value outside its table is its own reason.
MULTIPLEXERS = ("Joint", "Index")

# Frames this node alone may send: seeing one from outside means a second controller or a forger.
OWN_IDS = (CTRL_EMCY, CTRL_STATUS, CTRL_MEAS, CTRL_HB, ARM_CHALLENGE, CTRL_DIAG)
RECEIVED_IDS = (ACT_CMD, ACT_AUTH, BRIDGE_HB, ARM_REQUEST, ARM_RESPONSE, BRIDGE_DIAG)


def _reserved_mask(fields: tuple[Field, ...]) -> int:
    used = 0xFFFFFF
    for field in fields:
        used |= ((1 << field.bits) - 1) << field.start
    return ~used & 0xFFFFFFFFFFFFFFFF


RESERVED_MASK: dict[int, int] = {can_id: _reserved_mask(fields) for can_id, fields in FIELDS.items()}


def pack(can_id: int, values: tuple[int, ...]) -> bytes:
    """Eight bytes with CRC and counter still zero; `values` in the order of FIELDS[can_id].

    Raises ValueError on a value out of range: the controller never sends one, so this is a defect, not bus input.
    """
    word = 0
    for (name, start, bits, lowest, highest, _), value in zip(FIELDS[can_id], values, strict=True):
        if not lowest <= value <= highest:
            raise ValueError(f"frame 0x{can_id:03X}: {name} = {value} outside {lowest}..{highest}")
        word |= (value & ((1 << bits) - 1)) << start
    return word.to_bytes(FRAME_LENGTH, "little")


def unpack(can_id: int, data: bytes) -> tuple[Reject, tuple[int, ...]]:
    """Raw values of a frame in the order of FIELDS[can_id], or the reason why it is none. Never raises."""
    fields = FIELDS.get(can_id)
    if fields is None:
        return Reject.UNKNOWN_ID, ()
    if len(data) != FRAME_LENGTH:
        return Reject.LENGTH, ()
    word = int.from_bytes(data, "little")
    if word & RESERVED_MASK[can_id]:
        return Reject.RESERVED, ()
    values = []
    for name, start, bits, lowest, highest, allowed in fields:
        value = (word >> start) & ((1 << bits) - 1)
        if lowest < 0 and value >> (bits - 1):
            value -= 1 << bits
        if allowed is not None and value not in allowed:
            return Reject.ENUM, ()
        if not lowest <= value <= highest:
            return (Reject.MUX if name in MULTIPLEXERS else Reject.RANGE), ()
        values.append(value)
    return Reject.ACCEPTED, tuple(values)
