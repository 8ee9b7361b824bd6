"""The port on a serial adapter: python-can's slcan over a pseudo-terminal, against a small LAWICEL adapter."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

import pytest

from hilbridge.bus.port.asyncio_port import BusPort
from hilbridge.bus.port.state import SendResult
from hilbridge.records import Frame
from tests.bus.port.lawicel import WAIT_S, FakeAdapter

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals")


def options() -> dict[str, float]:
    return {"bitrate": 500_000, "sleep_after_open": 0.0}


async def test_frames_cross_a_serial_adapter_both_ways(tmp_path: Path) -> None:
    adapter = FakeAdapter(tmp_path / "tty")
    async with BusPort.open(f"slcan:{tmp_path / 'tty'}", listen_only=False, **options()) as port:
        assert port.is_physical
        await asyncio.to_thread(adapter.is_open.wait, WAIT_S)
        assert b"S6" in adapter.commands
        assert port.send(Frame(0x060, b"\x01\x02\x03")) is SendResult.SENT
        assert port.send(Frame(0x18DAF110, b"\xff", is_extended=True)) is SendResult.SENT
        assert await asyncio.to_thread(adapter.wait_sent, 2) == [b"t0603010203", b"T18DAF1101FF"]
        adapter.inject(b"t0A080102030405060708\rT123456781AB\rt0010\r")
        frames = [await asyncio.wait_for(port.receive(), WAIT_S) for _ in range(3)]
        assert [(frame.can_id, frame.data, frame.is_extended) for frame in frames] == [
            (0x0A0, bytes(range(1, 9)), False),
            (0x12345678, b"\xab", True),
            (0x001, b"", False),
        ]
    adapter.unplug()


async def test_a_physical_adapter_is_listen_only_unless_asked(tmp_path: Path) -> None:
    adapter = FakeAdapter(tmp_path / "tty")
    async with BusPort.open(f"slcan:{tmp_path / 'tty'}", **options()) as port:
        assert port.listen_only
        assert port.send(Frame(0x060, b"")) is SendResult.LISTEN_ONLY
        adapter.inject(b"t0A000\r")
        assert (await asyncio.wait_for(port.receive(), WAIT_S)).can_id == 0x0A0
    assert adapter.sent == []
    adapter.unplug()


async def test_the_port_comes_back_after_the_adapter_was_unplugged(tmp_path: Path) -> None:
    changed = asyncio.Event()
    adapter = FakeAdapter(tmp_path / "tty")
    spec = f"slcan:{tmp_path / 'tty'}"
    async with BusPort.open(spec, listen_only=False, on_change=lambda _: changed.set(), **options()) as port:
        adapter.unplug()
        (tmp_path / "tty").unlink()
        while port.counters.link_downs == 0:
            await asyncio.wait_for(changed.wait(), WAIT_S)
            changed.clear()
        assert port.send(Frame(0x060, b"lost")) is SendResult.DOWN
        again = FakeAdapter(tmp_path / "tty")
        while not port.state.link_up:
            await asyncio.wait_for(changed.wait(), WAIT_S)
            changed.clear()
        assert port.send(Frame(0x061, b"\x01")) is SendResult.SENT
        assert await asyncio.to_thread(again.wait_sent, 1) == [b"t061101"]
        again.inject(b"t0A0155\r")
        assert (await asyncio.wait_for(port.receive(), WAIT_S)).data == b"\x55"
        assert (port.counters.link_downs, port.counters.link_ups, port.counters.dropped_down) == (1, 1, 1)
    again.unplug()
