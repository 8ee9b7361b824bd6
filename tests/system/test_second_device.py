"""The second device of examples/, as a process, armed and made to assist by a real bridge over a simulated bus."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from pathlib import Path

from hilbridge.config import BusConfig, Config
from hilbridge.records import Action
from hilbridge.rows import TickRow
from hilbridge.runtime.assemble import live_bridge
from hilbridge.runtime.simulated_senses import SimulatedSenses
from hilbridge.wearer.person import Wearer
from tests.system.sure_bridge import GATE, PARTS, Sure

ROOT = Path(__file__).parents[2]


def test_a_real_bridge_arms_it_and_makes_it_assist() -> None:
    bus = f"hilsim:second-{os.getpid()}"
    command = [sys.executable, str(ROOT / "examples" / "second_device.py"), bus, str(ROOT / "dbc" / "iassistadl.dbc")]
    device = subprocess.Popen(command)
    ticks: list[TickRow] = []

    async def drive() -> None:
        config = Config(bus=BusConfig(spec=bus), gate=GATE)
        senses = SimulatedSenses(lambda: Wearer(3, width_px=96, height_px=72), config.sensors)
        async with live_bridge(config, PARTS, senses, lambda row: None, predict=Sure(), on_tick=ticks.append) as live:
            run = asyncio.create_task(live.run(60.0))
            while not run.done() and not (ticks and ticks[-1].device_state == "Assist"):
                await asyncio.sleep(0.02)
            live.stop()
            await run

    try:
        asyncio.run(drive())
    finally:
        device.kill()
        device.wait()
    assert {"Follow", "Ready", "Assist"} <= {row.device_state for row in ticks}
    assert any(row.armed and row.action is Action.ACT for row in ticks)
