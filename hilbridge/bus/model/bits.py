"""Exact lengths and bit sequences of CAN frames: stuff bits, CRC 15/17/21, fixed stuff bits (ISO 11898-1:2015, 10.4).

Two independent ways to the same number, which tests hold together: `frame_length` counts with byte-wise tables (about
two microseconds for eight bytes, it runs for every simulated frame), `encode` writes out every bit (for errors and
collisions, where the position of a bit matters).
"""

from __future__ import annotations

from typing import NamedTuple

from hilbridge.bus.model.frames import WireFrame, length_code

CRC15_POLY = 0x4599
CRC17_POLY = 0x1685B
CRC21_POLY = 0x102899

# CRC delimiter, ACK slot, ACK delimiter, end of frame; then three bits of intermission before the next frame.
TRAILER_BITS = 1 + 1 + 1 + 7
INTERMISSION_BITS = 3
# An error or overload delimiter is eight recessive bits after the flag.
ERROR_DELIMITER_BITS = 8
ERROR_FLAG_BITS = 6

_START = 0  # the state after SOF, a single dominant bit: (bit 0, run 1)


class FrameLength(NamedTuple):
    """Bits of one frame from SOF to the end of the end-of-frame field, without the three bits of intermission.

    `nominal_bits` are sent at the arbitration bit rate. `data_bits` is zero but for FD frames that switch: from after
    BRS to the CRC delimiter. (The switch happens at the sample points of BRS and of the CRC delimiter; with equal
    sample points their two halves add up to one bit of each rate, as counted here.)
    """

    nominal_bits: int
    data_bits: int
    stuff_bits: int


def _stuff_table(width: int) -> list[int]:
    """Per (state << 8 | bits): next state << 8 | inserted stuff bits << 12. State = last bit << 2 | (run - 1)."""
    table = [0] * (8 << 8)
    for state in range(8):
        for value in range(1 << width):
            bit, run, stuffed = state >> 2, (state & 3) + 1, 0
            for position in range(width - 1, -1, -1):
                now = value >> position & 1
                run = run + 1 if now == bit else 1
                bit = now
                if run == 5:  # the complement follows at once and begins a new run
                    stuffed += 1
                    bit, run = 1 - bit, 1
            table[state << 8 | value] = (bit << 2 | (run - 1)) << 8 | stuffed << 12
    return table


def _crc_table(poly: int, width: int) -> list[int]:
    top, mask = 1 << (width - 1), (1 << width) - 1
    table = []
    for byte in range(256):
        crc = byte << (width - 8)
        for _ in range(8):
            crc = (crc << 1 ^ poly if crc & top else crc << 1) & mask
        table.append(crc)
    return table


_STUFF8 = _stuff_table(8)
_STUFF7 = _stuff_table(7)
_CRC15 = _crc_table(CRC15_POLY, 15)

# Header of a classical frame -> (CRC, stuff state << 8, stuff bits): there are few headers on one bus.
_headers: dict[tuple[int, int, int], tuple[int, int, int]] = {}
_HEADER_CACHE_LIMIT = 8192


def _crc_bits(bits: list[int], poly: int, width: int, crc: int) -> int:
    mask = (1 << width) - 1
    for bit in bits:
        crc = (crc << 1 ^ (poly if (crc >> (width - 1)) ^ bit else 0)) & mask
    return crc


def _number(value: int, width: int) -> list[int]:
    return [value >> position & 1 for position in range(width - 1, -1, -1)]


def _header_bits(frame: WireFrame) -> tuple[list[int], int]:
    """All bits before the payload, unstuffed, and how many of them are sent before the data bit rate begins."""
    remote = 1 if frame.is_remote else 0
    bits = [0]
    if frame.is_extended:
        bits += [*_number(frame.can_id >> 18, 11), 1, 1, *_number(frame.can_id & 0x3FFFF, 18)]
    else:
        bits += _number(frame.can_id, 11)
    if frame.is_fd:
        bits += [0] if frame.is_extended else [0, 0]  # RRS, and IDE in base frames
        bits += [1, 0, 1 if frame.bit_rate_switch else 0]  # FDF, res, BRS
        before_data_rate = len(bits)
        bits += [1 if frame.error_state_indicator else 0]
    else:
        bits += [remote, 0, 0]  # RTR, then r1 and r0 (extended) or IDE and r0 (base)
        before_data_rate = len(bits)
    return bits + _number(length_code(frame), 4), before_data_rate


def _classical_header(frame: WireFrame, flags: int, code: int) -> tuple[int, int, int]:
    bits, _ = _header_bits(frame)
    crc = _crc_bits(bits, CRC15_POLY, 15, 0)
    bit, run, stuffed = 0, 0, 0
    for now in bits:
        run = run + 1 if now == bit else 1
        bit = now
        if run == 5:
            stuffed += 1
            bit, run = 1 - bit, 1
    if len(_headers) >= _HEADER_CACHE_LIMIT:
        _headers.clear()
    entry = (crc, (bit << 2 | (run - 1)) << 8, stuffed)
    _headers[frame.can_id, flags, code] = entry
    return entry


def frame_length(frame: WireFrame) -> FrameLength:
    """The exact length of a frame without fault (`frames.frame_fault`)."""
    return _fd_length(frame) if frame.is_fd else _classical_length(frame)


def _classical_length(frame: WireFrame) -> FrameLength:
    data = frame.data
    flags = (2 if frame.is_extended else 0) | (1 if frame.is_remote else 0)
    code = frame.remote_length if frame.is_remote else len(data)
    header = _headers.get((frame.can_id, flags, code))
    crc, state, stuffed = header if header is not None else _classical_header(frame, flags, code)
    for byte in data:
        crc = (crc << 8 & 0x7FFF) ^ _CRC15[crc >> 7 ^ byte]
        state = _STUFF8[state & 0xF00 | byte]
        stuffed += state >> 12
    state = _STUFF8[state & 0xF00 | crc >> 7]
    stuffed += (state >> 12) + (_STUFF7[state & 0xF00 | crc & 0x7F] >> 12)
    header_bits = 39 if frame.is_extended else 19
    return FrameLength(header_bits + 8 * len(data) + 15 + stuffed + TRAILER_BITS, 0, stuffed)


def _fd_length(frame: WireFrame) -> FrameLength:
    header, before_data_rate = _header_bits(frame)
    bit, run, stuffed, stuffed_before = 0, 0, 0, 0
    last = len(header) - 1 if not frame.data else -1
    for position, now in enumerate(header):
        run = run + 1 if now == bit else 1
        bit = now
        if run == 5 and position != last:  # a stuff condition at the very end is met by the first fixed stuff bit
            stuffed += 1
            stuffed_before += position < before_data_rate
            bit, run = 1 - bit, 1
    state = (bit << 2 | (run - 1)) << 8
    for byte in frame.data[:-1]:
        state = _STUFF8[state & 0xF00 | byte]
        stuffed += state >> 12
    if frame.data:
        stuffed += _last_byte_stuffing(state & 0xF00, frame.data[-1])
    # Stuff count (4 bits) and CRC with one fixed stuff bit before them and one after each further four bits.
    checksum = 4 + 17 + 6 if len(frame.data) <= 16 else 4 + 21 + 7
    total = len(header) + 8 * len(frame.data) + stuffed + checksum
    if not frame.bit_rate_switch:
        return FrameLength(total + TRAILER_BITS, 0, stuffed)
    nominal = before_data_rate + stuffed_before
    return FrameLength(nominal + TRAILER_BITS - 1, total - nominal + 1, stuffed)


def _last_byte_stuffing(state: int, byte: int) -> int:
    """Stuff bits of the last payload byte of an FD frame: none after its last bit, the fixed stuff bit stands there."""
    before = _STUFF7[state | byte >> 1]
    return before >> 12


class EncodedFrame(NamedTuple):
    """A frame bit by bit, from SOF to the end of end of frame, as its transmitter drives it (ACK slot recessive).

    `arbitration_end` is the index after the last bit in which a sender may lose arbitration; `stuffed` are the indices
    of inserted bits; bits before `dynamic_end` are stuffed dynamically, fixed stuff bits follow (FD). The CRC (FD: the
    stuff count) begins at `checksum_start`. `data_phase` are the indices sent at the data bit rate.
    """

    bits: tuple[int, ...]
    arbitration_end: int
    stuffed: frozenset[int]
    data_phase: tuple[int, int]
    checksum_start: int
    dynamic_end: int
    crc_delimiter: int

    @property
    def ack_slot(self) -> int:
        """Index of the ACK slot."""
        return self.crc_delimiter + 1


def encode(frame: WireFrame) -> EncodedFrame:
    """Write out every bit of a frame without fault."""
    header, before_data_rate = _header_bits(frame)
    arbitration_bits = (
        33 if frame.is_extended else 13
    )  # up to RTR/RRS; base frames up to IDE, which an extended rival loses on
    payload = [bit for byte in frame.data for bit in _number(byte, 8)]
    if frame.is_fd:
        out, stuffed, index_of = _stuff(header + payload, at_end=False)
        checksum_start = dynamic_end = len(out)
        out, fixed = _fd_checksum(out, len(stuffed), len(frame.data))
        stuffed = stuffed + fixed
    else:
        crc = _crc_bits(header + payload, CRC15_POLY, 15, 0)
        out, stuffed, index_of = _stuff(header + payload + _number(crc, 15), at_end=True)
        checksum_start, dynamic_end = index_of[len(header) + len(payload)], len(out)
    delimiter = len(out)
    out += [1, 1, 1] + [1] * 7
    phase = (index_of[before_data_rate - 1] + 1, delimiter + 1) if frame.bit_rate_switch else (0, 0)
    return EncodedFrame(
        tuple(out),
        index_of[arbitration_bits - 1] + 1,
        frozenset(stuffed),
        phase,
        checksum_start,
        dynamic_end,
        delimiter,
    )


def _stuff(bits: list[int], *, at_end: bool) -> tuple[list[int], list[int], list[int]]:
    """Insert stuff bits; gives the stuffed bits, the indices of inserted ones, and the index of each original bit."""
    out: list[int] = []
    inserted: list[int] = []
    index_of: list[int] = []
    run, last = 0, -1
    for position, bit in enumerate(bits):
        index_of.append(len(out))
        out.append(bit)
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5 and (at_end or position < len(bits) - 1):
            last, run = 1 - bit, 1
            inserted.append(len(out))
            out.append(last)
    return out, inserted, index_of


def _fd_checksum(out: list[int], dynamic_stuffed: int, length: int) -> tuple[list[int], list[int]]:
    """Append stuff count and CRC with fixed stuff bits; the CRC covers dynamic stuff bits but not fixed ones."""
    count = dynamic_stuffed % 8
    gray = _number(count ^ count >> 1, 3)
    stuff_count = [*gray, sum(gray) % 2]
    width, poly = (17, CRC17_POLY) if length <= 16 else (21, CRC21_POLY)
    crc = _crc_bits(out + stuff_count, poly, width, 1 << (width - 1))
    fixed: list[int] = []
    result = list(out)
    for position, bit in enumerate(stuff_count + _number(crc, width)):
        if position % 4 == 0:
            fixed.append(len(result))
            result.append(1 - result[-1])
        result.append(bit)
    return result, fixed
