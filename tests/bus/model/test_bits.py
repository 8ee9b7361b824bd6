"""Frame lengths and bits: two ways of counting, hand-worked frames, published CRCs, and an oracle of its own."""

from __future__ import annotations

import pytest
from crccheck.crc import Crc15Can, Crc17CanFd, Crc21CanFd
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.bus.model.bits import (
    CRC15_POLY,
    CRC17_POLY,
    CRC21_POLY,
    INTERMISSION_BITS,
    _crc_bits,
    _number,
    encode,
    frame_length,
)
from hilbridge.bus.model.frames import DLC_LENGTHS, FrameFault, WireFrame, arbitration_key, frame_fault

LUMPY = st.sampled_from([0x00, 0xFF, 0xF8, 0x07, 0x0F, 0x78]) | st.integers(0, 255)


@st.composite
def frames(draw: st.DrawFn) -> WireFrame:
    extended = draw(st.booleans())
    limit = 0x1FFF_FFFF if extended else 0x7FF
    can_id = draw(st.sampled_from([0, limit, 0x78, 0x7C0 & limit]) | st.integers(0, limit))
    if draw(st.booleans()):
        length = draw(st.sampled_from(DLC_LENGTHS))
        data = bytes(draw(st.lists(LUMPY, min_size=length, max_size=length)))
        return WireFrame(can_id, data, extended, True, draw(st.booleans()), draw(st.booleans()))
    length = draw(st.integers(0, 8))
    if draw(st.integers(0, 9)) == 0:
        return WireFrame(can_id, b"", extended, is_remote=True, remote_length=length)
    return WireFrame(can_id, bytes(draw(st.lists(LUMPY, min_size=length, max_size=length))), extended)


@given(frames())
def test_both_ways_of_counting_agree(frame: WireFrame) -> None:
    length, encoded = frame_length(frame), encode(frame)
    assert frame_fault(frame) is None
    assert length.nominal_bits + length.data_bits == len(encoded.bits)
    assert length.data_bits == encoded.data_phase[1] - encoded.data_phase[0]


@given(frames())
def test_no_six_equal_bits_before_the_crc_delimiter(frame: WireFrame) -> None:
    encoded = encode(frame)
    run, last = 0, -1
    for bit in encoded.bits[: encoded.crc_delimiter]:
        run = run + 1 if bit == last else 1
        last = bit
        assert run <= 5


@given(frames())
def test_destuffing_gives_identifier_payload_and_checksum_back(frame: WireFrame) -> None:
    encoded = encode(frame)
    plain = [bit for index, bit in enumerate(encoded.bits[: encoded.crc_delimiter]) if index not in encoded.stuffed]
    identifier = plain[1:12] + (plain[14:32] if frame.is_extended else [])
    assert int("".join(map(str, identifier)), 2) == frame.can_id
    width = (17 if len(frame.data) <= 16 else 21) if frame.is_fd else 15
    payload = plain[: len(plain) - width - (4 if frame.is_fd else 0)][-8 * len(frame.data) :] if frame.data else []
    assert payload == [bit for byte in frame.data for bit in _number(byte, 8)]
    checksum = int("".join(map(str, plain[-width:])), 2)
    if frame.is_fd:
        dynamic = [bit for index, bit in enumerate(encoded.bits[: encoded.dynamic_end])]
        poly = CRC17_POLY if width == 17 else CRC21_POLY
        assert checksum == _crc_bits(dynamic + plain[-width - 4 : -width], poly, width, 1 << (width - 1))
    else:
        assert checksum == _crc_bits(plain[:-15], CRC15_POLY, 15, 0)


@given(st.binary(max_size=64))
def test_crc_polynomials_are_the_published_ones(data: bytes) -> None:
    bits = [bit for byte in data for bit in _number(byte, 8)]
    assert _crc_bits(bits, CRC15_POLY, 15, 0) == Crc15Can.calc(data)
    assert _crc_bits(bits, CRC17_POLY, 17, 0) == Crc17CanFd.calc(data)
    assert _crc_bits(bits, CRC21_POLY, 21, 0) == Crc21CanFd.calc(data)


def test_hand_worked_shortest_classical_frame_of_zeros() -> None:
    # SOF, 11 ID, RTR, IDE, r0, 4 DLC: 19 zeros; their CRC is 15 zeros more. 34 zeros take a stuff bit after each five
    # of them: 6. Then CRC delimiter, ACK, ACK delimiter, 7 end of frame. 34 + 6 + 10 = 50, with intermission 53.
    length = frame_length(WireFrame(0x000))
    assert (length.nominal_bits, length.stuff_bits) == (50, 6)


def test_hand_worked_fd_frame_of_zeros() -> None:
    # 14 zeros (SOF to IDE): stuff bits after 5 and 10, 4 zeros remain; FDF 1; res, BRS, ESI, DLC: 7 zeros, one stuff
    # bit. 22 + 3 dynamic, then 4 stuff count + 17 CRC + 6 fixed stuff bits, then 10: 62.
    length = frame_length(WireFrame(0x000, is_fd=True))
    assert (length.nominal_bits, length.data_bits, length.stuff_bits) == (62, 0, 3)


def test_hand_worked_fd_frame_with_a_stuff_condition_at_the_end_of_the_data() -> None:
    # ID 0x555: 0 1010... no run of five up to IDE (0 10101010101 0 0), FDF 1, res 0, BRS 0, ESI 0, DLC 0001,
    # data 0x1F = 000 11111: the five ones end the data field, so their stuff bit is the first fixed one: 0 dynamic.
    # FDF 1 | 0 0 0 0 0 0 1: res BRS ESI and three zeros of the DLC are six zeros: one stuff bit after five.
    # 22 + 8 + 1, then 27, then 10: 68.
    length = frame_length(WireFrame(0x555, b"\x1f", is_fd=True))
    assert (length.nominal_bits, length.stuff_bits) == (68, 1)
    fixed = encode(WireFrame(0x555, b"\x1f", is_fd=True))
    assert fixed.bits[fixed.dynamic_end] == 0


def test_bit_rate_switch_splits_the_frame_at_brs_and_crc_delimiter() -> None:
    # Nominal: SOF, 11 ID, RRS, IDE, FDF, res, BRS = 17, and ACK, ACK delimiter, 7 EOF = 9. No stuff bit up to BRS.
    # Data rate: ESI, 4 DLC, 64 bytes, 4 + 21 + 7 checksum, CRC delimiter = 5 + 512 + 32 + 1, and dynamic stuff bits.
    length = frame_length(WireFrame(0x555, b"\x55" * 64, is_fd=True, bit_rate_switch=True))
    assert length.nominal_bits == 26
    assert length.data_bits == 550 + length.stuff_bits
    assert length.stuff_bits == 0


@given(frames().filter(lambda frame: not frame.is_fd))
def test_classical_length_keeps_the_textbook_bound(frame: WireFrame) -> None:
    # Davis et al. (2007): g + 8 s + 13 + floor((g + 8 s - 1) / 4) bits with intermission, g = 34 or 54.
    stuffable = (54 if frame.is_extended else 34) + 8 * len(frame.data)
    bits = frame_length(frame).nominal_bits + INTERMISSION_BITS
    assert stuffable + 13 <= bits <= stuffable + 13 + (stuffable - 1) // 4


def test_hand_worked_worst_classical_frame() -> None:
    # 0x078 with 3C 3C ...: SOF 0 and 0000, stuff; then every four equal bits and the stuff bit before them make five:
    # 1111, 000 + RTR 0: 3 stuff bits. IDE 0, r0 0, DLC 1000 break the pattern; 000 + 00 of the data: the 4th. The other
    # 62 data bits are 1111 0000 ...: 15 more. 19 before the CRC.
    frame = WireFrame(0x078, b"\x3c" * 8)
    encoded = encode(frame)
    assert len([index for index in encoded.stuffed if index < encoded.checksum_start]) == 19
    assert frame_length(frame).nominal_bits + INTERMISSION_BITS <= 135


def test_hand_worked_worst_fd_frame() -> None:
    # The same header (3 stuff bits up to RRS), IDE 0, FDF 1, res, BRS, ESI 000, DLC 1111 and the first data bit 1: the
    # 4th. Then 511 data bits 0000 1111 ...: 127 more. 22 + 512 + 131, then 4 + 21 + 7, then 10: 707.
    length = frame_length(WireFrame(0x078, b"\x87" * 64, is_fd=True))
    assert (length.nominal_bits, length.data_bits, length.stuff_bits) == (707, 0, 131)


@pytest.mark.parametrize(
    ("frame", "fault"),
    [
        (WireFrame(0x800), FrameFault.ID_RANGE),
        (WireFrame(-1), FrameFault.ID_RANGE),
        (WireFrame(0x2000_0000, is_extended=True), FrameFault.ID_RANGE),
        (WireFrame(1, bytes(9)), FrameFault.LENGTH),
        (WireFrame(1, bytes(9), is_fd=True), FrameFault.LENGTH),
        (WireFrame(1, b"x", is_remote=True), FrameFault.LENGTH),
        (WireFrame(1, is_remote=True, remote_length=9), FrameFault.LENGTH),
        (WireFrame(1, is_fd=True, is_remote=True), FrameFault.FD_REMOTE),
        (WireFrame(1, bit_rate_switch=True), FrameFault.SWITCH_WITHOUT_FD),
        (WireFrame(1, bytes(12), is_fd=True), None),
        (WireFrame(0x1FFF_FFFF, bytes(8), is_extended=True), None),
    ],
)
def test_frames_that_cannot_stand_on_the_wire_are_named(frame: WireFrame, fault: FrameFault | None) -> None:
    assert frame_fault(frame) is fault


@given(frames(), frames())
def test_arbitration_order_is_the_order_of_the_bits(one: WireFrame, other: WireFrame) -> None:
    def field(frame: WireFrame) -> list[int]:
        encoded = encode(frame)
        bits = [bit for index, bit in enumerate(encoded.bits) if index not in encoded.stuffed]
        return bits[: 33 if frame.is_extended else 14]

    first, second = field(one), field(other)
    if first != second:
        assert (first < second) == (arbitration_key(one) < arbitration_key(other))
    else:
        assert arbitration_key(one) == arbitration_key(other)
