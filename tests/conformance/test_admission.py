"""Who is tested and who is refused, each refusal in one line with its cure."""

from __future__ import annotations

import pytest

from hilbridge.bus.diagnosis import Observation, diagnose, known_messages
from hilbridge.bus.model.error_frames import CLASS_PROTOCOL
from hilbridge.conformance.admission import admit_bus, admit_company
from hilbridge.errors import InputError
from hilbridge.intent.provenance import Origin
from hilbridge.limits import MS
from hilbridge.records import Frame
from hilbridge.wire.codec import Codec
from hilbridge.wire.link import WireLink
from tests.conformance.lockstep import LockstepLine

CODEC = Codec()


def heard(milliseconds: int = 400) -> list[Frame]:
    """What a device says by itself."""
    line = LockstepLine()
    end_ns = line.now_ns() + milliseconds * MS
    frames = []
    while (frame := line.receive(end_ns)) is not None:
        frames.append(frame)
    return frames


def company(frames: list[Frame], *, physical: bool = False) -> None:
    seen = Observation("can0", 1.5, tuple(frames))
    admit_company(seen, diagnose(seen, known_messages(CODEC.path)), CODEC, physical=physical)


def test_a_virtual_bus_asks_for_nothing() -> None:
    admit_bus("vcan0", physical=False, on_a_bench=False, origin=Origin.RECORDED)


def test_a_physical_bus_asks_for_a_bench() -> None:
    with pytest.raises(InputError, match="--i-am-on-a-bench"):
        admit_bus("can0", physical=True, on_a_bench=False, origin=Origin.SIMULATED)
    admit_bus("can0", physical=True, on_a_bench=True, origin=Origin.SIMULATED)


def test_no_bench_with_a_bundle_of_people() -> None:
    with pytest.raises(InputError, match="recorded people"):
        admit_bus("can0", physical=True, on_a_bench=True, origin=Origin.RECORDED)
    with pytest.raises(InputError, match="unknown origin"):
        admit_bus("can0", physical=True, on_a_bench=True, origin=None)


def test_one_device_alone_is_tested() -> None:
    company(heard(), physical=True)


def test_a_board_that_is_not_there() -> None:
    with pytest.raises(InputError, match=r"no device is heard in .* s; switch it on"):
        company([])


def test_another_bit_rate() -> None:
    with pytest.raises(InputError, match="run at another bit rate; set the rate"):
        company([Frame(CLASS_PROTOCOL, bytes(8), is_error=True)] * 20)


def test_another_dbc() -> None:
    wrong = [frame._replace(data=bytes((frame.data[0] ^ 0x55, *frame.data[1:]))) for frame in heard()]
    with pytest.raises(InputError, match=r"do not fit the DBC \(.* RejCrc\); give both ends one DBC"):
        company(wrong)


def test_another_version_of_the_protocol() -> None:
    other = WireLink(CODEC).encode("CTRL_HB", {"ProtocolVersion": 2, "BootNonce": 7})
    with pytest.raises(InputError, match="speaks version 2 of the protocol, this is 1; flash"):
        company([*(frame for frame in heard() if frame.can_id != other.can_id), other])


def test_frames_that_come_twice() -> None:
    with pytest.raises(InputError, match=r"comes from two nodes: .*; take one of the two devices off"):
        company([frame for frame in heard() for _ in (1, 2)])


def test_another_bridge_is_company_on_every_bus() -> None:
    hold = WireLink(CODEC).encode("ACT_CMD", {})
    with pytest.raises(InputError, match="ACT_CMD"):
        company([*heard(), hold])


def test_whoever_is_not_in_the_dbc_is_company_on_a_physical_bus_only() -> None:
    company([*heard(), Frame(0x3FF, b"")])
    with pytest.raises(InputError, match="an unknown node sends 0x3FF"):
        company([*heard(), Frame(0x3FF, b"")], physical=True)
