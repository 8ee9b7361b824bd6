"""A whole bridge, its loop and simulated senses, against the emulated board; a gateway carries its line to a virtual bus."""

from __future__ import annotations

import asyncio
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import can
import pytest

from hilbridge.config import BusConfig, Config
from hilbridge.records import Action
from hilbridge.rows import TickRow
from hilbridge.runtime.assemble import live_bridge
from hilbridge.runtime.simulated_senses import SensorFault, SimulatedSenses
from hilbridge.wearer.person import Wearer
from tests.system.emulated.board import MISSING, Board, emulated
from tests.system.sure_bridge import GATE, PARTS, Sure

pytestmark = pytest.mark.skipif(bool(MISSING), reason=f"not installed: {', '.join(MISSING)}")
_OWN = can.Message(arbitration_id=0x0A0, data=bytes(8), is_extended_id=False)
_PATIENCE_S = 60.0


@contextmanager
def gateway(board: Board, bus: str) -> Iterator[can.BusABC]:
    """Carries every frame from the board's line to the bus and back, for as long as this lasts; gives the line."""
    channel = board.spec.partition(":")[2]
    over = threading.Event()

    def carry(source: can.BusABC, target: can.BusABC) -> None:
        while not over.is_set():
            message = source.recv(0.05)
            if message is not None:
                with suppress(can.CanError):
                    target.send(message)

    with (
        can.Bus(interface="slcan", channel=channel, bitrate=500_000, sleep_after_open=0) as line,
        can.Bus(interface="hilsim", channel=bus) as virtual,
    ):
        threads = [
            threading.Thread(target=carry, args=pair, daemon=True) for pair in ((line, virtual), (virtual, line))
        ]
        for thread in threads:
            thread.start()
        try:
            yield line
        finally:
            over.set()
            for thread in threads:
                thread.join(2.0)


@pytest.mark.timeout(400)
def test_a_real_bridge_arms_the_board_acts_holds_and_sees_it_latch(tmp_path: Path) -> None:
    name = f"board-{os.getpid()}"
    config = Config(bus=BusConfig(spec=f"hilsim:{name}"), gate=GATE)
    senses = SimulatedSenses(lambda: Wearer(3, width_px=96, height_px=72), config.sensors)
    ticks: list[TickRow] = []

    async def until(holds: Callable[[TickRow], bool], what: str) -> None:
        async with asyncio.timeout(_PATIENCE_S):
            while not (ticks and holds(ticks[-1])):
                await asyncio.sleep(0.02)
        print(f"{what}: tick {len(ticks)}")

    async def drive(line: can.BusABC) -> None:
        async with live_bridge(config, PARTS, senses, lambda row: None, predict=Sure(), on_tick=ticks.append) as live:
            run = asyncio.create_task(live.run(4 * _PATIENCE_S))
            await until(lambda row: row.armed and row.device_state == "Assist", "arms and acts")
            senses.gaze.fault = SensorFault.SILENT
            await until(lambda row: row.action is Action.HOLD and row.device_state in ("Ready", "Follow"), "holds")
            senses.gaze.fault = SensorFault.NONE
            await until(lambda row: row.device_state == "Assist", "acts again")
            line.send(_OWN)
            await until(lambda row: row.device_state == "Latched", "latches")
            assert ticks[-1].action is Action.HOLD
            live.stop()
            await run

    with emulated(tmp_path) as board, gateway(board, name) as line:
        asyncio.run(drive(line))
    assert any(row.action is Action.ACT for row in ticks)
