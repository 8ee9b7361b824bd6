"""The message set of a DBC as `hilbridge bus-analysis` needs it: how long each frame is at worst, how often it comes.

A message that is no single frame is left out by name: its frames belong to a transport protocol and are not in the DBC.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from hilbridge.bus.model.bits import INTERMISSION_BITS, TRAILER_BITS
from hilbridge.bus.model.frames import DLC_LENGTHS, WireFrame, arbitration_key
from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.wire.dbc_file import load_dbc, same_identifier, shown_id, shown_number

EVENT_DISTANCE_MS = 10.0  # the protocol repeats STOP every 10 ms; nothing is sent faster on purpose
_CLASSICAL_BYTES = 8
_LONGEST_SHORT_CRC_BYTES = 16  # longer FD frames have a CRC of 21 bits
# Stuff count and CRC with their fixed stuff bits.
_CHECKSUM_BITS = {17: 4 + 17 + 6, 21: 4 + 21 + 7}


@dataclass(frozen=True, slots=True)
class Stream:
    """One message of the set: how long its frames are at worst, how often they come, by when they must have arrived.

    `frame_bits` are sent at the arbitration bit rate and count the intermission too; `data_bits` at the data bit rate
    (CAN FD that switches). `period_ns` is the least time between two of them. `is_event`: no cycle is defined and the
    period is an assumption.
    """

    name: str
    can_id: int
    key: int
    payload_bytes: int
    frame_bits: int
    period_ns: int
    deadline_ns: int
    jitter_ns: int = 0
    is_event: bool = False
    is_extended: bool = False
    data_bits: int = 0
    is_fd: bool = False


class MessageSet(NamedTuple):
    """What of a DBC is analysed, what is not (name -> why), and the data bit rate that the file names (None: none)."""

    streams: list[Stream]
    left_out: dict[str, str]
    data_bitrate: int | None


def worst_frame_bits(payload_bytes: int, *, extended: bool = False) -> int:
    """Bits of the longest classical frame, with stuff bits and intermission (Davis et al. 2007, equation 1)."""
    stuffable = (54 if extended else 34) + 8 * payload_bytes
    return stuffable + 13 + (stuffable - 1) // 4


def worst_fd_bits(payload_bytes: int, *, extended: bool = False) -> tuple[int, int]:
    """(Nominal, data) bits of the longest CAN FD frame that switches its bit rate, with stuff bits and intermission.

    A stuff bit may follow every fourth bit from SOF to the end of the payload; those up to BRS cost the most.
    """
    before = 36 if extended else 17  # SOF to BRS
    stuffable = before + 5 + 8 * payload_bytes  # ESI and the length code follow
    stuffed_before, stuffed = (before - 1) // 4, (stuffable - 1) // 4
    checksum = _CHECKSUM_BITS[17 if payload_bytes <= _LONGEST_SHORT_CRC_BYTES else 21]
    nominal = before + stuffed_before + TRAILER_BITS - 1 + INTERMISSION_BITS
    return nominal, stuffable - before + stuffed - stuffed_before + checksum + 1


def streams_of_dbc(path: Path, *, event_distance_ms: float = EVENT_DISTANCE_MS) -> list[Stream]:
    """The streams of `read_message_set`."""
    return read_message_set(path, event_distance_ms=event_distance_ms).streams


def read_message_set(path: Path, *, event_distance_ms: float = EVENT_DISTANCE_MS) -> MessageSet:
    """Cycles from GenMsgCycleTime, deadlines from RxTimeoutMs where that is the shorter.

    A message without a cycle is an event that comes at most every `event_distance_ms`. Raises InputError for a file
    that is missing or no DBC, for two messages of one identifier, and where no message can be analysed.
    """
    database = load_dbc(path)
    for number, names in same_identifier(database.messages).items():
        raise InputError(
            f"{path}: messages {' and '.join(names)} have one identifier {shown_number(number)}; "
            "on a bus they would destroy each other: change the DBC"
        )
    network = _values(database.dbc)
    fd_bus = "FD" in str(network.get("BusType", "")).upper()
    streams: list[Stream] = []
    left_out: dict[str, str] = {}
    for message in database.messages:
        attributes = _values(message.dbc)
        is_fd = message.is_fd or (message.length > _CLASSICAL_BYTES and (fd_bus or not message.is_extended_frame))
        why = _left_out(message, is_fd=is_fd)
        if why:
            left_out[message.name] = why
        else:
            streams.append(_stream(message, attributes, is_fd, event_distance_ms))
    if not streams:
        raise InputError(
            f"{path}: no message of it can be analysed ({next(iter(left_out.values()))}); give another DBC"
        )
    rate = _number(network.get("BaudrateCANFD"))
    return MessageSet(streams, left_out, int(rate) if rate > 0 else None)


def _left_out(message: Any, *, is_fd: bool) -> str:
    shown = shown_id(message.frame_id, is_extended=message.is_extended_frame)
    if is_fd and message.length > DLC_LENGTHS[-1]:
        return f"{shown} has {message.length} bytes, more than any frame"
    if not is_fd and message.length > _CLASSICAL_BYTES:
        return (
            f"{shown} has {message.length} bytes: several frames of a transport protocol (J1939), or CAN FD not marked"
        )
    return ""


def _stream(message: Any, attributes: Mapping[str, Any], is_fd: bool, event_distance_ms: float) -> Stream:
    extended = bool(message.is_extended_frame)
    length = next(size for size in DLC_LENGTHS if size >= message.length)
    declared = _number(message.cycle_time)
    cycle_ms = declared if declared > 0 else event_distance_ms
    timeout_ms = _number(attributes.get("RxTimeoutMs"))
    deadline_ms = min(cycle_ms, timeout_ms) if timeout_ms > 0 else cycle_ms
    bits, data_bits = worst_frame_bits(length, extended=extended), 0
    if is_fd:
        bits, data_bits = worst_fd_bits(length, extended=extended)
        if _number(attributes.get("CANFD_BRS"), 1.0) == 0:  # the message keeps the arbitration bit rate
            bits, data_bits = bits + data_bits, 0
    key = arbitration_key(WireFrame(message.frame_id, b"", extended, is_fd=is_fd))
    return Stream(
        message.name,
        message.frame_id,
        key,
        length,
        bits,
        int(cycle_ms * MS),
        int(deadline_ms * MS),
        is_event=declared <= 0,
        is_extended=extended,
        data_bits=data_bits,
        is_fd=is_fd,
    )


def _values(specifics: Any) -> dict[str, Any]:
    attributes = (specifics.attributes if specifics else None) or {}
    return {name: entry.value for name, entry in attributes.items()}


def _number(value: Any, otherwise: float = 0.0) -> float:
    """A number of an attribute; `otherwise` for what is none (tools write text there)."""
    try:
        return otherwise if value is None else float(value)
    except (TypeError, ValueError):
        return otherwise
