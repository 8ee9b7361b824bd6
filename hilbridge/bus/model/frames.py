"""A CAN frame as the wire carries it, and the data-length codes of CAN FD (ISO 11898-1:2015, 10.4)."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

# Payload bytes of the sixteen data-length codes; classical frames use the first nine (codes 9..15 mean 8 there).
DLC_LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
_CODE_OF_LENGTH = {length: code for code, length in enumerate(DLC_LENGTHS)}

STANDARD_ID_MAX = 0x7FF
EXTENDED_ID_MAX = 0x1FFF_FFFF


class WireFrame(NamedTuple):
    """One data or remote frame. A tuple, because the medium makes one for every frame on the bus.

    `remote_length` is the length a remote frame asks for; it carries no data itself. `is_fd` frames may switch to
    the data bit rate (`bit_rate_switch`); their sender sets `error_state_indicator` while it is error passive.
    """

    can_id: int
    data: bytes = b""
    is_extended: bool = False
    is_fd: bool = False
    bit_rate_switch: bool = False
    error_state_indicator: bool = False
    is_remote: bool = False
    remote_length: int = 0


class FrameFault(StrEnum):
    """Why a frame cannot stand on the wire."""

    ID_RANGE = "identifier out of range"
    LENGTH = "no data-length code for this payload"
    FD_REMOTE = "CAN FD has no remote frames"
    SWITCH_WITHOUT_FD = "bit rate switch needs CAN FD"


def frame_fault(frame: WireFrame) -> FrameFault | None:
    """Name what is wrong with `frame`, or None. Never raises."""
    if not 0 <= frame.can_id <= (EXTENDED_ID_MAX if frame.is_extended else STANDARD_ID_MAX):
        return FrameFault.ID_RANGE
    if frame.is_fd:
        if frame.is_remote:
            return FrameFault.FD_REMOTE
        return None if len(frame.data) in _CODE_OF_LENGTH else FrameFault.LENGTH
    if frame.bit_rate_switch or frame.error_state_indicator:
        return FrameFault.SWITCH_WITHOUT_FD
    if frame.is_remote and (frame.data or not 0 <= frame.remote_length <= 8):
        return FrameFault.LENGTH
    return None if len(frame.data) <= 8 else FrameFault.LENGTH


def length_code(frame: WireFrame) -> int:
    """The four-bit data-length code of a frame without fault."""
    return frame.remote_length if frame.is_remote else _CODE_OF_LENGTH[len(frame.data)]


def arbitration_key(frame: WireFrame) -> int:
    """The arbitration field as a 32-bit number in the order it is sent: the lowest key wins, bit by bit.

    A base frame sends ID, RTR, IDE=0; an extended one ID[28:18], SRR=1, IDE=1, ID[17:0], RTR. FD frames send RRS=0
    in place of RTR (ISO 11898-1:2015, 10.4.2).
    """
    remote = 1 if frame.is_remote else 0
    if frame.is_extended:
        return (frame.can_id >> 18) << 21 | 0b11 << 19 | (frame.can_id & 0x3FFFF) << 1 | remote
    return frame.can_id << 21 | remote << 20
