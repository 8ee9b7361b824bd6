"""The device's hold on a bus, against a driver whose every answer the test writes: kinds, stamps, losses, bus-off (H9)."""

from __future__ import annotations

import errno
import socket
from collections import deque
from pathlib import Path

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim import attachment
from firmware_sim.attachment import Attachment, BusUnusable, Spec, parse_spec
from firmware_sim.memory import Received

SECOND = 1_000_000_000
KINDS = ("is_extended_id", "is_remote_frame", "is_fd")
OWN = Spec("hilsim", "scripted", False)
KERNEL = Spec("socketcan", "can9", True)


class Driver:
    """A python-can bus: gives what is in `waiting`, raises what is in `broken`, keeps what it is asked for."""

    def __init__(self) -> None:
        self.waiting: deque[can.Message] = deque()
        self.broken: Exception | None = None
        self.sent: list[can.Message] = []
        self.waits: list[float | None] = []
        self.shut = 0

    def recv(self, timeout: float | None = None) -> can.Message | None:
        self.waits.append(timeout)
        if self.broken is not None:
            raise self.broken
        return self.waiting.popleft() if self.waiting else None

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        self.waits.append(timeout)
        if self.broken is not None:
            raise self.broken
        self.sent.append(message)

    def shutdown(self) -> None:
        self.shut += 1


class Drivers:
    """Stands in for `can.Bus`: a driver each time somebody opens, or an error where `refuse` has one."""

    def __init__(self) -> None:
        self.opened: list[Driver] = []
        self.asked: list[dict[str, object]] = []
        self.refuse: Exception | None = None

    def __call__(self, **how: object) -> Driver:
        self.asked.append(how)
        if self.refuse is not None:
            raise self.refuse
        self.opened.append(Driver())
        return self.opened[-1]


class Clocks:
    """Wall and monotonic clock."""

    def __init__(self) -> None:
        self.wall_ns, self.mono_ns = 1_700_000_000 * SECOND, 50 * SECOND

    def time_ns(self) -> int:
        return self.wall_ns

    def monotonic_ns(self) -> int:
        return self.mono_ns


@pytest.fixture
def drivers(monkeypatch: pytest.MonkeyPatch) -> Drivers:
    made = Drivers()
    monkeypatch.setattr(attachment.can, "Bus", made)
    return made


@pytest.fixture
def clocks(monkeypatch: pytest.MonkeyPatch) -> Clocks:
    made = Clocks()
    monkeypatch.setattr(attachment, "time", made)
    return made


def frame(can_id: int = 0x60, data: bytes = b"", timestamp: float = 0.0, **kind: bool) -> can.Message:
    return can.Message(
        arbitration_id=can_id, data=data, timestamp=timestamp, **{"is_extended_id": False, **kind}, check=False
    )


# What kind a frame is


@pytest.mark.requirement("P9")
@pytest.mark.parametrize("kind", KINDS)
def test_h9_a_frame_of_another_kind_is_never_plain(drivers: Drivers, kind: str) -> None:
    mine = Attachment(OWN)
    drivers.opened[0].waiting.extend([frame(), frame(**{kind: True})])
    assert [arrival.frame for arrival in mine.read(1)] == [Received(0x60, b"", True), Received(0x60, b"", False)]
    assert mine.received == 2


@pytest.mark.requirement("P9")
@given(
    st.lists(st.tuples(st.booleans(), st.booleans(), st.booleans(), st.booleans(), st.binary(max_size=8)), max_size=20)
)
def test_h9_only_what_is_none_of_all_that_is_plain(kinds: list[tuple[bool, bool, bool, bool, bytes]]) -> None:
    driver = Driver()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(attachment.can, "Bus", lambda **_: driver)
        mine = Attachment(OWN)
    for extended, remote, fd, error, data in kinds:
        driver.waiting.append(
            frame(0x60, data, is_extended_id=extended, is_remote_frame=remote, is_fd=fd, is_error_frame=error)
        )
    expected = [  # a remote frame has no data
        Received(0x60, b"" if remote else data, not (extended or remote or fd))
        for extended, remote, fd, error, data in kinds
        if not error
    ]
    assert [arrival.frame for arrival in mine.read(1)] == expected
    assert mine.received == len(expected)


def test_only_the_frames_of_bus_off_and_restart_say_anything_about_bus_off(drivers: Drivers) -> None:
    mine = Attachment(OWN)
    assert not mine.bus_off
    seen = []
    for error_class in (0x001, 0x040, 0x001, 0x100, 0x044, 0x020, 0x140, 0x080):
        drivers.opened[0].waiting.append(frame(error_class, is_error_frame=True))
        assert mine.read(1) == []
        seen.append(mine.bus_off)
    assert seen == [False, True, True, False, True, True, False, False]
    assert (mine.received, mine.link_errors) == (0, 0)


# Waiting


def test_nothing_waits_for_the_bus_and_a_flood_is_read_in_parts(drivers: Drivers) -> None:
    mine = Attachment(OWN)
    driver = drivers.opened[0]
    driver.waiting.extend(frame(0x700, k.to_bytes(2, "big")) for k in range(5000))
    first, second = mine.read(1), mine.read(1)
    assert (len(first), len(second), mine.received) == (4096, 904, 5000)
    assert [int.from_bytes(a.frame.data, "big") for a in first + second] == list(range(5000))
    mine.send(0xA0, b"12", 1)
    assert set(driver.waits) == {0}


def test_what_it_sends_is_a_plain_frame(drivers: Drivers) -> None:
    mine = Attachment(OWN)
    mine.send(0xA0, b"12", 1)
    sent = drivers.opened[0].sent[0]
    assert (sent.arbitration_id, bytes(sent.data)) == (0xA0, b"12")
    assert [getattr(sent, kind) for kind in (*KINDS, "is_error_frame")] == [False] * 4
    assert (mine.sent, mine.dropped, mine.received) == (1, 0, 0)


# Stamps


def read_stamp(mine: Attachment, driver: Driver, now_ns: int, timestamp: float) -> int:
    driver.waiting.append(frame(timestamp=timestamp))
    return mine.read(now_ns)[0].arrived_ns


def test_kernel_stamps_are_shifted_to_the_monotonic_clock(drivers: Drivers, clocks: Clocks) -> None:
    mine = Attachment(OWN)
    driver = drivers.opened[0]
    stamp = clocks.wall_ns / SECOND
    assert abs(read_stamp(mine, driver, 51 * SECOND, stamp + 0.25) - 50_250_000_000) < 1000
    assert read_stamp(mine, driver, 51 * SECOND, stamp + 7.0) == 51 * SECOND  # not in the future
    assert read_stamp(mine, driver, 52 * SECOND, stamp + 0.5) == 51 * SECOND  # not before the one of before
    assert read_stamp(mine, driver, 52 * SECOND, 0.0) == 52 * SECOND  # a driver without stamps


def test_the_first_stamps_of_all_are_right_at_any_age_of_the_computer(drivers: Drivers, clocks: Clocks) -> None:
    clocks.mono_ns = 0
    mine = Attachment(OWN)
    stamp = clocks.wall_ns / SECOND
    assert read_stamp(mine, drivers.opened[0], 0, stamp - 3.0) == 0  # of before this computer began: as old as can be
    assert abs(read_stamp(mine, drivers.opened[0], 400_000_000, stamp + 0.125) - 125_000_000) < 1000


def test_a_wall_clock_that_is_set_is_noticed_within_a_second(drivers: Drivers, clocks: Clocks) -> None:
    mine = Attachment(OWN)
    driver = drivers.opened[0]
    stamp = clocks.wall_ns / SECOND
    read_stamp(mine, driver, 50 * SECOND, stamp)
    clocks.wall_ns += 100 * SECOND  # somebody sets the clock
    assert read_stamp(mine, driver, 51 * SECOND, stamp + 100.5) == 51 * SECOND
    assert read_stamp(mine, driver, 51 * SECOND + 1, stamp + 100.9) == 51 * SECOND  # right, and not before the other
    assert abs(read_stamp(mine, driver, 51 * SECOND + 1_000_000, stamp + 101.0005) - 51_000_500_000) < 2000


# Losses


@pytest.mark.parametrize("error", [can.CanOperationError("gone"), OSError(errno.ENETDOWN, "down")])
def test_a_lost_bus_is_opened_anew_every_tenth_of_a_second(drivers: Drivers, error: Exception) -> None:
    mine = Attachment(OWN)
    first = drivers.opened[0]
    first.broken = error
    assert mine.read(1_000) == []
    assert (first.shut, mine.link_errors) == (1, 1)
    drivers.refuse = can.CanInitializationError("still gone")
    for now_ns, tries in ((100_000_999, 1), (100_001_000, 2), (200_000_999, 2), (200_001_000, 3)):
        assert mine.read(now_ns) == []
        assert len(drivers.asked) == tries
    drivers.refuse = None
    mine.send(0xA0, b"", 300_000_999)
    assert (mine.dropped, mine.sent) == (1, 0)
    mine.send(0xA0, b"", 300_001_000)
    assert (mine.dropped, mine.sent, mine.link_errors) == (1, 1, 1)
    assert mine.read(900 * SECOND) == []
    assert drivers.asked == [{"interface": "hilsim", "channel": "scripted"}] * 4


def test_frames_read_before_the_driver_fails_are_kept(drivers: Drivers) -> None:
    mine = Attachment(OWN)
    driver = drivers.opened[0]

    def recv(timeout: float | None = None) -> can.Message:
        driver.broken = OSError("gone")
        driver.recv = Driver.recv.__get__(driver)  # type: ignore[method-assign]
        return frame(0x60, b"1")

    driver.recv = recv  # type: ignore[assignment,method-assign]
    assert [arrival.frame.data for arrival in mine.read(5)] == [b"1"]
    assert mine.link_errors == 1


def test_a_socket_of_the_kernel_outlives_its_link(drivers: Drivers) -> None:
    mine = Attachment(KERNEL)
    driver = drivers.opened[0]
    driver.broken = OSError(errno.ENETDOWN, "down")
    assert mine.read(1) == []
    mine.send(0xA0, b"", 2)
    assert (driver.shut, mine.link_errors, mine.dropped) == (0, 1, 1)
    driver.broken = None
    mine.send(0xA0, b"", 3)
    assert (len(drivers.opened), mine.sent) == (1, 1)


def test_a_send_that_fails_is_dropped_and_the_bus_stays(drivers: Drivers) -> None:
    mine = Attachment(OWN)
    drivers.opened[0].broken = can.CanOperationError("full")
    mine.send(0xA0, b"", 1)
    assert (mine.dropped, mine.sent, mine.link_errors, drivers.opened[0].shut) == (1, 0, 0, 0)


def test_closed_it_has_left_the_bus_once(drivers: Drivers) -> None:
    mine = Attachment(OWN)
    mine.close()
    mine.close()
    assert drivers.opened[0].shut == 1
    assert mine.read(10 * SECOND) == []
    mine.send(0xA0, b"", 10 * SECOND)
    assert (len(drivers.opened), mine.sent, mine.dropped) == (1, 0, 1)


def test_a_bus_that_was_lost_and_then_closed_is_not_opened_anew(drivers: Drivers) -> None:
    mine = Attachment(OWN)
    drivers.opened[0].broken = OSError("gone")
    mine.read(1)
    mine.close()
    assert mine.read(10 * SECOND) == []
    assert len(drivers.opened) == 1


def test_the_kernel_is_asked_to_keep_what_a_stalled_computer_reads_late(
    drivers: Drivers, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    class Watched(socket.socket):
        def setsockopt(self, *how: object) -> None:  # type: ignore[override]
            asked.append(how)

    with Watched() as raw:
        monkeypatch.setattr(Driver, "socket", raw, raising=False)
        Attachment(KERNEL)
    assert asked == [(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)]


# Names of buses


@pytest.fixture
def kernel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A /sys of the test's own."""
    monkeypatch.setattr(attachment, "Path", lambda first, *rest: tmp_path.joinpath(first.strip("/"), *rest))
    folder = tmp_path / "sys/class/net"
    folder.mkdir(parents=True)
    return folder


def test_auto_is_the_kernels_virtual_bus_where_there_is_one(kernel: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert parse_spec("auto") == Spec("hilsim", "hilbridge", False)
    (kernel / "vcan0").mkdir()
    assert parse_spec("auto") == Spec("socketcan", "vcan0", False)
    monkeypatch.setattr(attachment.sys, "platform", "win32")
    assert parse_spec("auto") == Spec("hilsim", "hilbridge", False)


@pytest.mark.parametrize("name", ["vcan0", "vxcan3"])
def test_h1_a_name_alone_makes_no_bus_virtual(kernel: Path, name: str) -> None:
    assert not parse_spec(name).physical
    (kernel / name / "device").mkdir(parents=True)  # a real card under that name
    assert parse_spec(name).physical


@pytest.mark.parametrize(
    "text", ["can0", "slcan0", "xvcan0", "pcan:PCAN_USBBUS1", "vcan:0", "Virtual:x", "socketcan:can0", "hilsimx:a"]
)
def test_h1_whatever_is_not_known_to_be_virtual_is_physical(kernel: Path, text: str) -> None:
    assert parse_spec(text).physical


@pytest.mark.parametrize(
    ("spec", "error", "says"),
    [
        (KERNEL, OSError(errno.EAFNOSUPPORT, "x"), "this kernel has no CAN; --bus hilsim:demo needs none"),
        (KERNEL, OSError(errno.ENODEV, "No such device"), "`ip link set can9 up`"),
        (KERNEL, can.CanInitializationError("x"), "`ip link set can9 up`"),
        (OWN, OSError(errno.EAFNOSUPPORT, "no family"), "no family; python-can's page on 'hilsim'"),
        (OWN, NameError("PCANBasic"), "cannot be opened: NameError: PCANBasic; python-can's page"),
        (OWN, can.CanInitializationError("absent"), "cannot be opened: absent; python-can's page"),
        (OWN, ValueError("odd"), "cannot be opened: odd; python-can's page"),
    ],
)
def test_a_bus_that_cannot_be_opened_says_what_would_help(
    drivers: Drivers, spec: Spec, error: Exception, says: str
) -> None:
    drivers.refuse = error
    with pytest.raises(BusUnusable) as raised:
        Attachment(spec)
    assert says in str(raised.value)
