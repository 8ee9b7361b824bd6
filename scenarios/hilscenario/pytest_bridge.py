"""The bridge as a test runs it: in a thread of its own, so that pytest keeps its signals and its priority."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from hilbridge.config import BusConfig, Config
from hilbridge.demo import DEMO_SEED
from hilbridge.errors import InputError
from hilbridge.rows import TickRow
from hilbridge.run import Outcome, RunOptions, run_bridge
from hilbridge.runtime.account.judge import judge_by
from hilbridge.runtime.assemble import read_parts
from hilbridge.runtime.simulated_senses import SimulatedSenses
from hilbridge.wearer.person import Wearer
from hilbridge.wearer.shaking import Tremor


class _Silent:
    """Nobody looks on but the test."""

    def tick(self, seconds: float, row: TickRow) -> None:
        """Not shown."""

    def notice(self, text: str) -> None:
        """pytest shows it where the test fails."""
        print(text)  # noqa: T201

    def over(self, text: str) -> None:
        """Not shown."""


class TestBridge:
    """Runs the bridge on a bus with a simulated wearer. Each run leaves its recording in a folder of its own."""

    __test__ = False  # no class of tests, whatever pytest makes of its name

    def __init__(self, bus: str, folder: Path) -> None:
        self.bus = bus
        self._folder = folder
        self._runs = 0

    def run(self, seconds: float = 5.0, *, seed: int = DEMO_SEED, tremor_hz: float = 0.0) -> Outcome:
        """Run for so long; gives summary, recording and report. Raises InputError."""
        if not seconds > 0.0:
            raise InputError(f"seconds {seconds:g}: must be above 0")
        self._runs += 1
        out = self._folder / str(self._runs)
        out.mkdir(parents=True)
        with ThreadPoolExecutor(1) as pool:
            return pool.submit(self._run, seconds, seed, tremor_hz, out).result()

    def _run(self, seconds: float, seed: int, tremor_hz: float, out: Path) -> Outcome:
        config = Config(bus=BusConfig(spec=self.bus))

        def wearer() -> Wearer:
            return Wearer(seed, tremor=Tremor(tremor_hz) if tremor_hz > 0 else None)

        senses = SimulatedSenses(wearer, config.sensors)
        options = RunOptions(f"test: wearer {seed}", seconds, judge=judge_by(wearer().truth, senses.epoch_ns))
        return asyncio.run(run_bridge(config, read_parts(config), senses, out, options, _Silent()))
