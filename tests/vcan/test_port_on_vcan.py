"""The port on a real SocketCAN interface, seen by a stranger (candump)."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from hilbridge.bus.port.asyncio_port import BusPort
from hilbridge.bus.port.netlink import read_link
from hilbridge.bus.port.state import SendResult
from hilbridge.records import Frame
from tests.bus.port.lawicel import FakeAdapter

SETTLE_S = 5.0


def ip(*arguments: str) -> None:
    subprocess.run(["ip", "link", *arguments], check=True)


@pytest.fixture
def link() -> Iterator[str]:
    """A vcan interface of our own, so that taking it down disturbs nobody."""
    if os.geteuid() != 0:
        pytest.skip("taking a link down needs root")
    ip("add", "dev", "vcan7", "type", "vcan")
    ip("set", "vcan7", "up")
    yield "vcan7"
    subprocess.run(["ip", "link", "del", "vcan7"], check=False)


@asynccontextmanager
async def candump(interface: str, *options: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """A candump that surely listens: frames of a probe identifier are sent until it shows one."""
    process = await asyncio.create_subprocess_exec("candump", "-L", *options, interface, stdout=asyncio.subprocess.PIPE)
    assert process.stdout is not None
    try:
        async with BusPort.open(interface, listen_only=False) as probe:
            line = asyncio.ensure_future(process.stdout.readline())
            while not line.done():
                probe.send(Frame(0x7FE, b"probe"))
                await asyncio.wait([line], timeout=0.05)
        yield process
    finally:
        process.terminate()
        await process.wait()


async def lines_of(process: asyncio.subprocess.Process, count: int) -> list[str]:
    """The next `count` lines that are not the probe, without their stamps and interface names."""
    assert process.stdout is not None
    found: list[str] = []
    while len(found) < count:
        line = (await asyncio.wait_for(process.stdout.readline(), SETTLE_S)).decode().split()
        if not line[2].startswith("7FE#"):
            found.append(line[2])
    return found


async def until(condition: object, what: str) -> None:
    """Let the loop run until `condition()` holds."""
    assert callable(condition)
    async with asyncio.timeout(SETTLE_S):
        while not condition():
            await asyncio.sleep(0.005)


async def test_candump_sees_what_the_port_sends() -> None:
    async with BusPort.open("vcan0", listen_only=False) as port, candump("vcan0") as stranger:
        assert not port.is_physical
        for value in range(20):
            assert port.send(Frame(0x060, bytes([value] * 8))) is SendResult.SENT
        assert port.send(Frame(0x001, b"")) is SendResult.SENT
        assert port.send(Frame(0x18DAF110, b"\x01\x02", is_extended=True)) is SendResult.SENT
        expected = [f"060#{bytes([value] * 8).hex().upper()}" for value in range(20)]
        assert await lines_of(stranger, 22) == [*expected, "001#", "18DAF110#0102"]
        assert port.counters.sent == 22


async def test_the_port_receives_what_cansend_sends_with_both_clocks() -> None:
    async with BusPort.open("vcan0", listen_only=False) as port:
        process = await asyncio.create_subprocess_exec("cansend", "vcan0", "0A0#0102030405060708")
        await process.wait()
        frame = await asyncio.wait_for(port.receive(), SETTLE_S)
        assert (frame.can_id, frame.data) == (0x0A0, bytes(range(1, 9)))
        now_ns = asyncio.get_running_loop().time() * 1e9
        assert 0 <= now_ns - frame.received_ns < SETTLE_S * 1e9
        assert frame.wall_ns > 1_600_000_000 * 10**9


async def test_the_port_reports_and_survives_the_link_going_down_and_up(link: str) -> None:
    changes: list[bool] = []
    async with BusPort.open(link, listen_only=False, on_change=lambda s: changes.append(s.link_up)) as port:
        await until(lambda: port.state.link_up, "link up")
        ip("set", link, "down")
        await until(lambda: not port.state.link_up, "link down seen")
        assert port.send(Frame(0x060, b"lost")) is SendResult.DOWN
        ip("set", link, "up")
        await until(lambda: port.state.link_up, "link up seen")
        async with BusPort.open(link, listen_only=False) as other:
            assert other.send(Frame(0x0A0, b"again")) is SendResult.SENT
            assert (await asyncio.wait_for(port.receive(), SETTLE_S)).data == b"again"
            assert port.send(Frame(0x060, b"back")) is SendResult.SENT
            assert (await asyncio.wait_for(other.receive(), SETTLE_S)).data == b"back"
        assert (port.counters.link_downs, port.counters.link_ups, port.counters.dropped_down) == (1, 1, 1)
        assert changes == [True, False, True]


async def test_the_port_comes_back_after_its_interface_was_gone_altogether(link: str) -> None:
    async with BusPort.open(link, listen_only=False) as port:
        await until(lambda: port.state.link_up, "link up")
        ip("del", link)
        await until(lambda: not port.state.link_up, "interface gone")
        ip("add", "dev", link, "type", "vcan")
        ip("set", link, "up")
        await until(lambda: port.state.link_up, "interface back")
        async with BusPort.open(link, listen_only=False) as other:
            other.send(Frame(0x0A0, b"again"))
            assert (await asyncio.wait_for(port.receive(), SETTLE_S)).data == b"again"


async def test_frames_lost_by_a_slow_reader_are_counted() -> None:
    async with BusPort.open("vcan0", listen_only=False) as sender, BusPort.open("vcan0", listen_only=True) as reader:
        total = 60_000  # more than eight megabytes of socket buffer hold
        for value in range(total):
            assert sender.send(Frame(0x123, value.to_bytes(4, "little"))) is SendResult.SENT
        seen = 0
        async with asyncio.timeout(60):
            while seen + reader.counters.overflow_kernel + reader.counters.overflow_port < total:
                if reader.receive_nowait() is not None:
                    seen += 1
                    continue
                # The kernel tells its losses with the next frame that arrives.
                sender.send(Frame(0x124, b""))
                total += 1
                await asyncio.sleep(0)
        assert seen + reader.counters.overflow_kernel + reader.counters.overflow_port == total
        assert reader.counters.overflow_kernel > 0


async def test_listen_only_sends_nothing() -> None:
    async with BusPort.open("vcan0", listen_only=True) as port, candump("vcan0") as stranger:
        assert port.send(Frame(0x060, b"never")) is SendResult.LISTEN_ONLY
        async with BusPort.open("vcan0", listen_only=False) as other:
            other.send(Frame(0x061, b"marker"))
        assert await lines_of(stranger, 1) == ["061#6D61726B6572"]
        assert port.counters.dropped_listen_only == 1


def test_the_kernel_says_what_vcan0_is() -> None:
    info = read_link("vcan0")
    assert info is not None
    assert (info.name, info.kind, info.is_up, info.is_virtual) == ("vcan0", "vcan", True, True)
    assert info.bitrate is None


async def test_link_down_and_up_during_traffic_loses_only_what_the_counters_say(link: str) -> None:
    async with BusPort.open(link, listen_only=False) as sender, BusPort.open(link, listen_only=True) as receiver:
        got: list[int] = []
        results: list[SendResult] = []

        async def send_on(count: int) -> None:
            for _ in range(count):
                results.append(sender.send(Frame(0x060, len(results).to_bytes(4, "little"))))
                if len(results) % 20 == 0:
                    await asyncio.sleep(0.001)

        for _ in range(5):
            await send_on(200)
            ip("set", link, "down")
            await send_on(200)
            await until(lambda: not sender.state.link_up and not receiver.state.link_up, "both saw it")
            ip("set", link, "up")
            await until(lambda: sender.state.link_up and receiver.state.link_up, "both are back")
        await send_on(200)
        while (frame := receiver.receive_nowait()) is not None or len(got) < sender.counters.sent:
            if frame is None:
                frame = await asyncio.wait_for(receiver.receive(), SETTLE_S)
            got.append(int.from_bytes(frame.data, "little"))
        sent = [number for number, result in enumerate(results) if result is SendResult.SENT]
        assert got == sent
        assert sender.counters.sent + sender.counters.dropped_down == len(results) == 2200
        assert sender.counters.dropped_down >= 200
        assert (sender.counters.link_downs, receiver.counters.link_downs) == (5, 5)
        assert receiver.counters.overflow_kernel == 0


async def test_programs_of_their_own_share_the_bus() -> None:
    """Three processes at once on one processor: two python-can programs answer each other, candump watches."""
    program = (
        "import can, sys\n"
        "bus = can.Bus(interface='socketcan', channel='vcan0')\n"
        "print('ready', flush=True)\n"
        "for _ in range(100):\n"
        "    while (m := bus.recv(10)).arbitration_id != 0x200: pass\n"
        "    bus.send(can.Message(arbitration_id=0x201, is_extended_id=False, data=m.data))\n"
    )
    async with candump("vcan0") as stranger, BusPort.open("vcan0", listen_only=False) as port:
        child = await asyncio.create_subprocess_exec(sys.executable, "-c", program, stdout=asyncio.subprocess.PIPE)
        assert child.stdout is not None
        assert (await child.stdout.readline()).strip() == b"ready"
        for number in range(100):
            port.send(Frame(0x200, bytes([number])))
            answer = await asyncio.wait_for(port.receive(), SETTLE_S)
            assert (answer.can_id, answer.data) == (0x201, bytes([number]))
        assert await asyncio.wait_for(child.wait(), SETTLE_S) == 0
        seen = await lines_of(stranger, 200)
        assert seen == [f"{can_id}#{number:02X}" for number in range(100) for can_id in (200, 201)]


@pytest.mark.skipif(not Path("/sys/module/slcan").exists(), reason="no slcan driver in this kernel")
async def test_a_serial_adapter_under_the_kernels_driver_is_a_wire(tmp_path: Path) -> None:
    """The kernel's slcan on a pseudo-terminal: a SocketCAN interface that does reach a wire."""
    adapter = FakeAdapter(tmp_path / "tty")
    command = ["slcand", "-F", "-o", "-s6", str((tmp_path / "tty").readlink()), "slcan7"]
    driver = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.DEVNULL)
    try:
        await until(lambda: read_link("slcan7") is not None, "the interface")
        ip("set", "slcan7", "up")
        info = read_link("slcan7")
        assert info is not None
        assert (info.is_up, info.is_virtual) == (True, False)
        async with BusPort.open("slcan7") as mute:
            assert mute.is_physical
            assert mute.send(Frame(0x060, b"\x01")) is SendResult.LISTEN_ONLY
        async with BusPort.open("slcan7", listen_only=False) as port:
            assert port.send(Frame(0x060, b"\x01\x02")) is SendResult.SENT
            assert await asyncio.to_thread(adapter.wait_sent, 1) == [b"t06020102"]
            adapter.inject(b"t0A0155\r")
            assert (await asyncio.wait_for(port.receive(), SETTLE_S)).data == b"\x55"
    finally:
        driver.terminate()
        await driver.wait()
        adapter.unplug()
