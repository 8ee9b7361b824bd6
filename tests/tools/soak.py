"""The bridge for a long time against a device: `make soak MINUTES=30`, or `python -m tests.tools.soak --minutes 30 [--hands]`.

Made pictures at 720p30 (`--fps`) and gaze at 200 Hz go the whole way; a scripted belief makes it assist two seconds of every
four, so that a late command would trip the device. Exit code 1 where memory grew by more than 5 MB after the first minute
(or the first third of a shorter run), the device tripped, or the bridge's books do not balance.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any

from hilbridge.config import BusConfig, Config, GateSection, SensorsConfig
from hilbridge.demo import DeviceProcess
from hilbridge.intent.predictor import Predictor
from hilbridge.observe.keeping.background import BackgroundRecording
from hilbridge.observe.signals import SignalRows
from hilbridge.priority import use_realtime_scheduling
from hilbridge.records import FeatureVector, IntentEstimate
from hilbridge.runtime.account.stages import Histogram, Stage
from hilbridge.runtime.assemble import live_bridge, read_parts
from hilbridge.runtime.live import LiveBridge
from hilbridge.runtime.senses import open_senses
from tests.tools.recording_cost import FPS, make_inputs

GROWTH_MB = 5.0
WARM_S = 60.0
EDGES_MS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 40.0)
_PERIOD_NS = 4_000_000_000


class Sure(Predictor):
    """Works as the predictor does, and says what the script wants: sure for two seconds, unsure for two."""

    def step(self, vector: FeatureVector, produced_ns: int) -> IntentEstimate | None:
        found = super().step(vector, produced_ns)
        if found is None:
            return None
        sure = produced_ns % _PERIOD_NS < _PERIOD_NS // 2
        chances = tuple(0.97 if index == 0 else 0.03 / 20 for index in range(len(found.probabilities)))
        return replace(found, probabilities=chances, verb_index=0, confidence=0.97 if sure else 0.1)


@dataclass(frozen=True)
class Soaked:
    """What a run came to. `memory_mb`: of this process, once a second."""

    memory_mb: tuple[float, ...]
    trips: int
    acts: int
    stages: tuple[Stage, ...]
    late: tuple[int, ...]
    ticks_missed: int
    balanced: bool

    @property
    def growth_mb(self) -> float:
        """From the end of the first minute (of a shorter run its first third) to the end, each a median of ten seconds."""
        count = len(self.memory_mb)
        warm = min(round(WARM_S), count // 3)
        width = max(1, min(10, count // 6))
        return median(self.memory_mb[-width:]) - median(self.memory_mb[warm : warm + width])

    def problems(self) -> list[str]:
        """Why it is not well."""
        found = []
        if self.growth_mb > GROWTH_MB:
            found.append(f"memory grew by {self.growth_mb:.1f} MB")
        if self.trips:
            late = max((one.max_ms for one in self.stages if one.name == "tick late"), default=0.0)
            found.append(f"{self.trips} trips of the device while ticks came up to {late:.0f} ms late")
        if not self.acts:
            found.append("it never assisted")
        if not self.balanced:
            found.append("a source's books do not balance")
        return found


def resident_mb() -> float:
    """Of this process."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGESIZE") / 1e6


async def soak(folder: Path, seconds: float, *, hands: bool, fps: float = FPS, every_s: float = 1.0) -> Soaked:
    """One run."""
    bus = f"hilsim:soak-{os.getpid()}"
    film = make_inputs(folder)
    sensors = SensorsConfig(camera=str(film), camera_fps=fps, gaze=str(folder / "gaze.csv"), hands=hands, loop=True)
    config = Config(sensors=sensors, bus=BusConfig(spec=bus), gate=GateSection(tau_on=0.8, tau_off=0.6, alpha=0.6))
    parts, senses = read_parts(config), open_senses(sensors)
    memory: list[float] = []
    device = DeviceProcess(bus, folder / "device.jsonl")
    recording = BackgroundRecording(folder / "recording.mcap", SignalRows(parts.codec))
    try:
        async with live_bridge(config, parts, senses, recording.write, predict=Sure(parts.bundle)) as live:
            stages = live.profile()
            use_realtime_scheduling()
            watching = asyncio.create_task(_watch(memory, live, every_s))
            await live.run(seconds)
            watching.cancel()
            acts, missed = live.node.bridge.diag["Acts"], live.ticks_missed
    finally:
        device.stop()
        recording.close()
    late = stages.of("tick late") or Histogram()
    counts = (senses.camera.cell.counts(), senses.vision.vectors.counts())
    balanced = all(one.received == one.used + one.overwritten + one.failed for one in counts)
    told: dict[str, Any] = device.summary
    return Soaked(
        tuple(memory), int(told["trips"]), acts, stages.table(), tuple(late.shares(EDGES_MS)), missed, balanced
    )


async def _watch(memory: list[float], live: LiveBridge, every_s: float) -> None:
    while True:
        await asyncio.sleep(every_s)
        memory.append(resident_mb())


def report(found: Soaked) -> str:
    """In words."""
    lines = [f"{'stage':22}{'times':>8}{'p50 ms':>9}{'p99 ms':>9}{'max ms':>9}"]
    lines += [f"{one.name:22}{one.count:8}{one.p50_ms:9.2f}{one.p99_ms:9.2f}{one.max_ms:9.2f}" for one in found.stages]
    edges = [f"< {edge:g} ms" for edge in EDGES_MS] + ["more"]
    lines.append("ticks late by: " + ", ".join(f"{edge} {n}" for edge, n in zip(edges, found.late, strict=True) if n))
    lines.append(f"ticks missed {found.ticks_missed}, acts {found.acts}, trips {found.trips}")
    lines.append(f"memory {found.memory_mb[-1]:.0f} MB, grown by {found.growth_mb:+.1f} MB after it was warm")
    return "\n".join(lines)


def main() -> int:
    """Run, print, judge."""
    parser = argparse.ArgumentParser(prog="python -m tests.tools.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--hands", action="store_true", help="find hands as well (extra `hands`)")
    parser.add_argument("--fps", type=float, default=FPS, help="of the pictures; at 25 ticks lock to them")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        found = asyncio.run(soak(Path(name), 60.0 * options.minutes, hands=options.hands, fps=options.fps))
    problems = found.problems()
    if options.json:
        print(json.dumps({"growth_mb": found.growth_mb, "trips": found.trips, "problems": problems}))
    else:
        print(report(found))
        print("; ".join(problems) or "well")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
