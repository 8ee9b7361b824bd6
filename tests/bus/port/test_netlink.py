from __future__ import annotations

import struct

from hypothesis import given
from hypothesis import strategies as st

from hilbridge.bus.port.netlink import parse_link, read_link, request


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
