"""What the kernel hands us, byte by byte: netlink answers, CAN frames, error frames. Garbage never raises."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.bus.model.error_frames import ErrorKind, ErrorState, read_error_frame, write_error_frame
from hilbridge.bus.port.netlink import parse_link, read_link, request
from hilbridge.bus.port.socketcan import pack_can_frame, parse_can_frame
from hilbridge.records import Frame


def attribute(kind: int, payload: bytes) -> bytes:
    raw = struct.pack("=HH", 4 + len(payload), kind) + payload
    return raw + b"\0" * (-len(raw) % 4)


def answer(*, up: bool = True, kind: bytes = b"can\0", data: bytes = b"") -> bytes:
    info = attribute(1, kind) + attribute(2 | 0x8000, data)
    body = struct.pack("=BxHiII", 0, 280, 3, int(up), 0)
    body += attribute(3, b"can0\0") + attribute(13, struct.pack("=I", 10)) + attribute(18, info)
    return struct.pack("=IHHII", 16 + len(body), 16, 0, 1, 0) + body


def test_everything_the_kernel_says_of_a_can_interface_is_read() -> None:
    data = attribute(1, struct.pack("=8I", 500_000, 875, 0, 0, 0, 0, 1, 4))
    data += attribute(4, struct.pack("=I", 2)) + attribute(5, struct.pack("=II", 0x22, 0x02))
    data += attribute(6, struct.pack("=I", 100)) + attribute(8, struct.pack("=HH", 130, 7))
    data += attribute(9, struct.pack("=8I", 2_000_000, 0, 0, 0, 0, 0, 0, 0))
    link = parse_link(answer(data=data))
    assert link is not None
    assert (link.name, link.kind, link.is_up, link.is_virtual, link.tx_queue_length) == ("can0", "can", True, False, 10)
    assert (link.bitrate, link.data_bitrate, link.state, link.restart_ms) == (500_000, 2_000_000, "error-passive", 100)
    assert (link.tx_errors, link.rx_errors, link.listen_only, link.is_fd) == (130, 7, True, False)


def test_an_interface_that_says_nothing_is_taken_for_a_wire() -> None:
    link = parse_link(answer(up=False, kind=b"strange\0"))
    assert link is not None
    assert (link.is_up, link.is_virtual, link.bitrate, link.state, link.tx_errors) == (False, False, None, None, None)
    virtual = parse_link(answer(kind=b"vxcan\0"))
    assert virtual is not None
    assert virtual.is_virtual


def test_an_error_is_no_answer() -> None:
    assert parse_link(struct.pack("=IHHII", 36, 2, 0, 1, 0) + struct.pack("=i", -19) + request("can0")[:16]) is None
    assert read_link("no-such-interface") is None


@given(st.binary(max_size=200))
def test_no_netlink_bytes_raise(raw: bytes) -> None:
    parse_link(raw)
    parse_link(answer(data=raw))
    parse_link(answer()[: len(raw)])


@given(
    st.booleans().flatmap(
        lambda extended: st.tuples(st.just(extended), st.integers(0, 0x1FFF_FFFF if extended else 0x7FF))
    ),
    st.binary(max_size=8),
)
def test_frames_survive_the_kernels_structure(identity: tuple[bool, int], data: bytes) -> None:
    extended, can_id = identity
    frame = Frame(can_id, data, 1, 2, is_extended=extended, hardware_ns=3)
    assert parse_can_frame(pack_can_frame(frame), 1, 2, 3) == frame
    fd = Frame(can_id, data, 1, 2, is_extended=extended, is_fd=True)
    assert parse_can_frame(pack_can_frame(fd), 1, 2, 0) == fd


@given(st.binary(max_size=80))
def test_no_frame_bytes_raise(raw: bytes) -> None:
    frame = parse_can_frame(raw, 0, 0, 0)
    assert (frame is None) == (len(raw) not in (16, 72))


@pytest.mark.parametrize(
    ("state", "tec", "rec"),
    [
        (ErrorState.ACTIVE, 0, 0),
        (ErrorState.WARNING, 96, 0),
        (ErrorState.WARNING, 0, 119),
        (ErrorState.PASSIVE, 128, 0),
        (ErrorState.PASSIVE, 0, 135),
        (ErrorState.BUS_OFF, 256, 0),
    ],
)
def test_error_frames_say_what_was_written(state: ErrorState, tec: int, rec: int) -> None:
    event = read_error_frame(*write_error_frame(state, tec, rec))
    assert (event.controller, event.tx_errors, event.rx_errors) == (state, min(tec, 255), rec)


@pytest.mark.parametrize("kind", list(ErrorKind))
def test_failed_attempts_change_no_state(kind: ErrorKind) -> None:
    event = read_error_frame(*write_error_frame(None, 8, 0, kind=kind, sending=True))
    assert (event.controller, event.tx_errors, event.no_ack) == (None, 8, kind is ErrorKind.ACK)


def test_error_frames_as_linux_drivers_write_them() -> None:
    # A gs_usb adapter with nobody on the bus: CAN_ERR_ACK; then CAN_ERR_CRTL with TX_PASSIVE; a full receive buffer.
    assert read_error_frame(0x020, bytes(8)).no_ack
    passive = read_error_frame(0x004, bytes((0, 0x20, 0, 0, 0, 0, 128, 0)))
    assert (passive.controller, passive.tx_errors) == (ErrorState.PASSIVE, 128)
    assert read_error_frame(0x004, bytes((0, 0x01, 0, 0, 0, 0, 0, 0))).overflow
    assert read_error_frame(0x040, b"").controller is ErrorState.BUS_OFF
    assert read_error_frame(0x100, b"").controller is ErrorState.ACTIVE


@given(st.integers(0, 0x1FFF_FFFF), st.binary(max_size=64))
def test_no_error_frame_raises(can_id: int, data: bytes) -> None:
    read_error_frame(can_id, data)
