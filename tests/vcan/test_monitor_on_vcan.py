"""`hilbridge monitor` on a kernel bus: what the device says stands in its views, and its STOP stops a real process."""

from __future__ import annotations

import asyncio
import json
import socket
import struct
import subprocess
import sys
from typing import Any

import pytest

from tests.system.operator.rig import monitor

aiohttp = pytest.importorskip("aiohttp")
pytestmark = [pytest.mark.vcan, pytest.mark.timeout(300)]
PATIENCE_S = 120.0


async def _stop_from_the_page(url: str) -> tuple[str, dict[str, Any]]:
    """What the device was at first, and the view after STOP."""
    async with (
        asyncio.timeout(PATIENCE_S),
        aiohttp.ClientSession() as session,
        session.ws_connect(url + "live") as page,
    ):

        async def view(*words: str) -> dict[str, Any]:
            while True:
                told = await page.receive_json()
                if told.get("state", {}).get("word") in words:
                    return told

        first = await view("FOLLOW", "READY")
        await page.send_str("STOP")
        while "stop" not in (told := await page.receive_json()):
            pass
        assert told == {"stop": ""}
        return first["state"]["reason"], await view("STOPPED")


def test_the_monitor_shows_and_stops_a_device_on_a_kernel_bus() -> None:
    listener = socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    listener.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, struct.pack("=II", 0x001, 0x7FF))
    listener.bind(("vcan0",))
    device = subprocess.Popen(
        [sys.executable, "-m", "firmware_sim.node", "--bus", "vcan0"], stdout=subprocess.PIPE, text=True
    )
    try:
        assert device.stdout is not None
        assert "ready" in device.stdout.readline()
        with monitor("--bus", "vcan0") as (url, _):
            reason, stopped = asyncio.run(_stop_from_the_page(url))
        assert reason == "The bridge is silent; the device follows by itself."
        assert (stopped["state"]["kind"], stopped["bus"]["up"]) == ("fault", True)
        listener.setblocking(False)
        frames = []
        while True:
            try:
                frames.append(listener.recv(16))
            except BlockingIOError:
                break
        assert [struct.unpack("=IB", frame[:5]) for frame in frames] == [(0x001, 0)] * 3
    finally:
        listener.close()
        device.terminate()
        told, _ = device.communicate(timeout=30)
    assert json.loads(told.splitlines()[-1].removeprefix("firmware-sim done "))["received"] >= 3
