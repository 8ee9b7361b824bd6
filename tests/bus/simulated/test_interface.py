"""The simulated bus between processes: it starts by itself, outlives its clients, drops nothing silently."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import uuid
from collections.abc import Iterator
from itertools import pairwise

import can
import pytest

from hilbridge.bus.port.asyncio_port import BusPort
from hilbridge.bus.port.spec import BusUnavailable
from hilbridge.bus.port.state import SendResult
from hilbridge.bus.simulated.client import BusClient, BusNotReachable
from hilbridge.bus.simulated.server import BusNameTaken, claim
from hilbridge.records import Frame

WAIT_S = 20.0


@pytest.fixture
def name() -> Iterator[str]:
    return f"test-{uuid.uuid4()}"


def message(can_id: int, data: bytes = b"") -> can.Message:
    return can.Message(arbitration_id=can_id, data=data, is_extended_id=False)


def flood(bus: can.BusABC) -> None:
    for _ in range(50):
        bus.send(message(0x61))


def test_python_can_programs_meet_on_a_name(name: str) -> None:
    with can.Bus(interface="hilsim", channel=name) as one, can.Bus(interface="hilsim", channel=name) as other:
        one.send(message(0x60, b"12345678"))
        got = other.recv(WAIT_S)
        assert got is not None
        assert (got.arbitration_id, bytes(got.data), got.is_rx) == (0x60, b"12345678", True)
        other.send(can.Message(arbitration_id=0x18DAF110, is_fd=True, bitrate_switch=True, data=bytes(range(64))))
        got = one.recv(WAIT_S)
        assert got is not None
        assert got.is_fd
        assert got.bitrate_switch
        assert got.is_extended_id
        assert bytes(got.data) == bytes(range(64))


def test_filters_and_own_messages(name: str) -> None:
    wanted = [{"can_id": 0x60, "can_mask": 0x7FF}]
    with (
        can.Bus(interface="hilsim", channel=name, can_filters=wanted) as filtered,
        can.Bus(interface="hilsim", channel=name, receive_own_messages=True) as own,
    ):
        for can_id in (0x50, 0x60, 0x70):
            own.send(message(can_id))
        echoed = [own.recv(WAIT_S) for _ in range(3)]
        assert [(m.arbitration_id, m.is_rx) for m in echoed if m] == [(0x50, False), (0x60, False), (0x70, False)]
        got = filtered.recv(WAIT_S)
        assert got is not None
        assert got.arbitration_id == 0x60
        assert filtered.recv(0.0) is None


def test_a_full_transmit_queue_is_an_error_like_a_real_interface(name: str) -> None:
    # 10 kbit/s: one frame takes over four milliseconds, so the queue of ten is full long before one is gone.
    with (
        can.Bus(interface="hilsim", channel=name, bitrate=10_000) as sender,
        can.Bus(interface="hilsim", channel=name, bitrate=10_000) as receiver,
    ):
        for value in range(10):
            sender.send(message(0x60, bytes([value] * 8)))
        with pytest.raises(can.CanOperationError, match="transmit queue full"):
            flood(sender)
        first = receiver.recv(WAIT_S)
        assert first is not None
        assert first.data[0] == 0
        sender.send(message(0x61), timeout=WAIT_S)


def test_the_bus_outlives_a_killed_client(name: str) -> None:
    program = (
        "import can, sys, time\n"
        f"bus = can.Bus(interface='hilsim', channel={name!r})\n"
        "bus.send(can.Message(arbitration_id=0x123, is_extended_id=False))\n"
        "print('attached', flush=True)\n"
        "time.sleep(60)\n"
    )
    child = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE)
    assert child.stdout is not None
    assert child.stdout.readline().strip() == b"attached"  # this child also started the bus
    with can.Bus(interface="hilsim", channel=name) as one, can.Bus(interface="hilsim", channel=name) as other:
        os.kill(child.pid, signal.SIGKILL)
        child.wait()
        child.stdout.close()
        one.send(message(0x1))
        got = other.recv(WAIT_S)
        assert got is not None
        assert got.arbitration_id == 0x1


def test_frames_queued_before_leaving_are_still_sent(name: str) -> None:
    with can.Bus(interface="hilsim", channel=name) as stays:
        with can.Bus(interface="hilsim", channel=name) as leaves:
            for value in range(5):
                leaves.send(message(0x001, bytes([value])))
        assert [m.data[0] for m in (stays.recv(WAIT_S) for _ in range(5)) if m] == [0, 1, 2, 3, 4]


def test_a_name_is_served_once(name: str) -> None:
    client = BusClient(name)
    with pytest.raises(BusNameTaken):
        claim(name)
    client.close()


def test_attaching_without_starting_names_the_bus() -> None:
    with pytest.raises(BusNotReachable, match="nobody-here"):
        BusClient("nobody-here", start=False)


async def test_notifier_of_python_can_works_with_asyncio(name: str) -> None:
    with can.Bus(interface="hilsim", channel=name) as one, can.Bus(interface="hilsim", channel=name) as other:
        reader = can.AsyncBufferedReader()
        notifier = can.Notifier(other, [reader], loop=asyncio.get_running_loop())
        for value in range(5):
            one.send(message(0x60, bytes([value])))
        got = [await asyncio.wait_for(reader.get_message(), WAIT_S) for _ in range(5)]
        notifier.stop()
        assert [m.data[0] for m in got] == [0, 1, 2, 3, 4]


async def test_port_sends_receives_and_counts(name: str) -> None:
    async with BusPort.open(f"hilsim:{name}") as one, BusPort.open(f"hilsim:{name}", listen_only=True) as other:
        assert not one.is_physical
        for value in range(5):
            assert one.send(Frame(0x60, bytes([value]))) is SendResult.SENT
        frames = [await asyncio.wait_for(other.receive(), WAIT_S) for _ in range(5)]
        assert [frame.data[0] for frame in frames] == [0, 1, 2, 3, 4]
        assert all(later.received_ns > earlier.received_ns for earlier, later in pairwise(frames))
        assert other.send(Frame(0x60, b"")) is SendResult.LISTEN_ONLY
        assert (one.counters.sent, other.counters.received, other.counters.dropped_listen_only) == (5, 5, 1)
    assert one.send(Frame(0x60, b"")) is SendResult.CLOSED


async def test_a_flooded_port_keeps_the_newest_of_each_identifier(name: str) -> None:
    spec = f"hilsim:{name}"
    async with BusPort.open(spec, bitrate=10_000) as flood, BusPort.open(spec, bitrate=10_000) as other:
        results = [flood.send(Frame(0x60, bytes([value] * 8))) for value in range(200)]
        assert SendResult.QUEUED in results
        counters = flood.counters
        assert counters.sent < 200
        assert counters.dropped_superseded > 100
        assert (await asyncio.wait_for(other.receive(), WAIT_S)).data[0] == 0


async def test_port_recovers_when_the_process_of_the_bus_dies(name: str) -> None:
    changed = asyncio.Event()
    command = [sys.executable, "-m", "hilbridge.bus.simulated.server", name]
    server = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
    assert server.stdout is not None
    assert (await server.stdout.readline()).decode().split() == ["serving", name]
    try:
        async with BusPort.open(f"hilsim:{name}", on_change=lambda _: changed.set()) as port:
            server.kill()
            await server.wait()
            while port.counters.link_ups == 0:
                await asyncio.wait_for(changed.wait(), WAIT_S)
                changed.clear()
            async with BusPort.open(f"hilsim:{name}") as other:
                other.send(Frame(0x0A0, b"back"))
                assert (await asyncio.wait_for(port.receive(), WAIT_S)).data == b"back"
            assert (port.counters.link_downs, port.counters.link_ups) == (1, 1)
    finally:
        if server.returncode is None:
            server.kill()
            await server.wait()


async def test_any_python_can_interface_through_threads() -> None:
    async with BusPort.open("virtual:threads") as one, BusPort.open("virtual:threads") as other:
        for value in range(5):
            one.send(Frame(0x60, bytes([value])))
        got = [await asyncio.wait_for(other.receive(), WAIT_S) for _ in range(5)]
        assert [frame.data[0] for frame in got] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(
    ("spec", "says"),
    [
        ("", "write auto"),
        ("hilsim:", "write auto"),
        ("nosuchcan9", "no such network interface"),
        ("nosuchdriver:0", "nosuchdriver"),
        ("hilsim:" + "x" * 65, "1..64 bytes"),
    ],
)
async def test_a_bus_that_cannot_be_opened_says_so_in_one_line(spec: str, says: str) -> None:
    with pytest.raises(BusUnavailable, match=says) as caught:
        async with BusPort.open(spec):
            pass
    assert "\n" not in str(caught.value)
