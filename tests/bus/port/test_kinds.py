"""FD, remote, extended and error frames stay what they are through every backend, so that none is taken as plain (H9)."""

from __future__ import annotations

import itertools
import struct

import can
import pytest

from hilbridge.bus.port.python_can import _frame_of, _message_of
from hilbridge.bus.port.socketcan import pack_can_frame, parse_can_frame
from hilbridge.records import Frame
from hilbridge.wire.codec import Codec, Rejected, RejectReason
from hilbridge.wire.link import WireLink

CODEC = Codec()
KINDS = [
    {"is_error": error, "is_fd": fd, "is_extended": extended, "is_remote": remote}
    for error, fd, extended, remote in itertools.product((False, True), repeat=4)
]
SENT = [kind for kind in KINDS if not kind["is_error"] and not (kind["is_fd"] and kind["is_remote"])]


def kind_of(frame: Frame) -> dict[str, bool]:
    return {name: getattr(frame, name) for name in KINDS[0]}


def status() -> Frame:
    return WireLink(CODEC, "CONTROLLER").encode("CTRL_STATUS", {"State": "Follow"})


@pytest.mark.requirement("P9")
@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_h9_python_can_keeps_the_kind(kind: dict[str, bool]) -> None:
    message = can.Message(
        arbitration_id=0x0A0,
        data=status().data,
        is_error_frame=kind["is_error"],
        is_fd=kind["is_fd"],
        is_extended_id=kind["is_extended"],
        is_remote_frame=kind["is_remote"],
        check=False,
    )
    assert kind_of(_frame_of(message)) == kind


@pytest.mark.requirement("P9")
@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_h9_the_kernel_keeps_the_kind(kind: dict[str, bool]) -> None:
    flags = kind["is_error"] << 29 | kind["is_remote"] << 30 | kind["is_extended"] << 31
    data = status().data
    classical, fd = ("=IB3x8s", (8, data)), ("=IBB2x64s", (8, 0, data))
    layout, rest = fd if kind["is_fd"] else classical
    raw = struct.pack(layout, 0x0A0 | flags, *rest)
    frame = parse_can_frame(raw, 1, 2, 3)
    assert frame is not None
    assert kind_of(frame) == kind
    assert frame.data == (b"" if kind["is_remote"] else data)


@pytest.mark.parametrize("kind", SENT, ids=str)
def test_what_is_sent_is_of_the_kind_that_it_is(kind: dict[str, bool]) -> None:
    frame = Frame(0x0A0, b"" if kind["is_remote"] else b"12345678", **kind)
    through_kernel = parse_can_frame(pack_can_frame(frame), 1, 2, 3)
    assert through_kernel is not None
    assert kind_of(through_kernel) == kind
    assert kind_of(_frame_of(_message_of(frame))) == kind


@pytest.mark.requirement("P9")
@pytest.mark.parametrize("kind", [kind for kind in KINDS if any(kind.values())], ids=str)
def test_h9_a_right_frame_of_the_wrong_kind_is_counted_and_nothing_else(kind: dict[str, bool]) -> None:
    link, right = WireLink(CODEC), status()
    outcome = link.decode(Frame(right.can_id, right.data, **kind))
    assert isinstance(outcome, Rejected)
    assert outcome.reason is RejectReason.KIND
    assert link.counters["RejKind"] == 1
    assert not isinstance(link.decode(right), Rejected)  # its counter was not taken for seen
