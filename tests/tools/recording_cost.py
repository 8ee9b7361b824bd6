"""What recording costs: the same run at 720p30 with a device, recorded and not. `python -m tests.tools.recording_cost`.

CPU is of the whole process, so encoding, compressing and writing are in it. Each run is a process of its own; the order
alternates, and of each figure the least of the repeats counts, since this machine may have other work.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from hilbridge.config import BusConfig, Config, SensorsConfig
from hilbridge.demo import DeviceProcess
from hilbridge.observe.keeping.background import BackgroundRecording
from hilbridge.observe.keeping.pictures import PictureFormat, Pictures
from hilbridge.observe.reading import read_recording
from hilbridge.observe.signals import SignalRows
from hilbridge.observe.summary import percentile
from hilbridge.priority import use_realtime_scheduling
from hilbridge.rows import Row, TickRow
from hilbridge.runtime.assemble import live_bridge, read_parts
from hilbridge.runtime.provenance import first_rows
from hilbridge.runtime.senses import open_senses

FPS = 30.0
_FIGURES = ("cpu_percent", "tick_work_p99_ms", "tick_jitter_p99_ms")


def make_inputs(folder: Path) -> Path:
    """A 720p film with edges, colours and noise, and a gaze, 4 s each."""
    film = folder / "film.avi"
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*"MJPG"), FPS, (1280, 720))
    chance = np.random.default_rng(1)
    coarse = cv2.resize(chance.integers(0, 256, (18, 32, 3), np.uint8), (1400, 788), interpolation=cv2.INTER_CUBIC)
    for number in range(round(4 * FPS)):
        picture = coarse[number % 60 : number % 60 + 720, number : number + 1280].astype(np.int16)
        writer.write(np.clip(picture + chance.integers(-6, 7, picture.shape, np.int16), 0, 255).astype(np.uint8))
    writer.release()
    (folder / "gaze.csv").write_text(
        "time_s,x,y\n" + "\n".join(f"{k / 200},0.5,{0.4 + k % 50 / 250}" for k in range(800))
    )
    return film


async def run(folder: Path, film: Path, seconds: float, *, recorded: bool) -> dict[str, float]:
    """One run; its figures."""
    bus = f"hilsim:cost-{os.getpid()}"
    sensors = SensorsConfig(camera=str(film), camera_fps=FPS, gaze=str(folder / "gaze.csv"), hands=False, loop=True)
    config = Config(sensors=sensors, bus=BusConfig(spec=bus))
    parts, senses, ticks = read_parts(config), open_senses(sensors), list[TickRow]()
    device = DeviceProcess(bus, folder / "device.jsonl")
    recording = BackgroundRecording(folder / "recording.mcap", SignalRows(parts.codec)) if recorded else None
    pictures = Pictures(PictureFormat(), recording.write) if recording is not None else None

    def nowhere(row: Row) -> None:
        return None

    try:
        record = nowhere if recording is None else recording.write
        async with live_bridge(config, parts, senses, record, on_tick=ticks.append) as live:
            for row in first_rows(config, parts, live.port, "cost", time.monotonic_ns()):
                record(row)
            if pictures is not None:
                live.on_picture = lambda frame, look: pictures.offer(frame, look.ready_ns, look)
            use_realtime_scheduling()
            cpu_s = time.process_time()
            await live.run(seconds)
            cpu_s = time.process_time() - cpu_s
    finally:
        device.stop()
        if pictures is not None:
            pictures.close()
        if recording is not None:
            recording.close()
    late_ms = [abs((after.time_ns - before.time_ns) / 1e6 - 40.0) for before, after in pairwise(ticks)]
    figures = {
        "cpu_percent": 100.0 * cpu_s / seconds,
        "tick_work_p99_ms": percentile([row.work_ms or 0.0 for row in ticks], 0.99) or 0.0,
        "tick_jitter_p99_ms": percentile(late_ms, 0.99) or 0.0,
    }
    if recording is not None and pictures is not None:
        kept = sum(1 for _ in read_recording(recording.path))
        figures |= {"rows": kept, "rows_lost": recording.lost_rows, "pictures": pictures.stored}
        figures["pictures_lost"] = pictures.dropped + pictures.failed + recording.lost_pictures
        figures["megabytes_per_minute"] = recording.path.stat().st_size / 1e6 * 60 / seconds
    return figures


def compared(
    repeats: int, figures: tuple[str, ...], measure: Callable[[str], dict[str, float]]
) -> tuple[dict[str, list[dict[str, float]]], dict[str, float]]:
    """Measure sides "on" and "off" in turns and print them: the runs of each, what "on" adds to each figure's least."""
    sides: dict[str, list[dict[str, float]]] = {"on": [], "off": []}
    for number in range(repeats):
        for side in ("on", "off") if number % 2 else ("off", "on"):
            sides[side].append(measure(side))
            print(side, {key: round(value, 2) for key, value in sides[side][-1].items()}, flush=True)
    adds = {}
    for key in figures:
        off, on = (min(run[key] for run in sides[side]) for side in ("off", "on"))
        adds[key] = on - off
        print(f"{key:20} off {off:.2f}  on {on:.2f}  adds {adds[key]:.2f}")
    return sides, adds


def _process(folder: str, seconds: float, side: str) -> dict[str, float]:
    """One run in a process of its own."""
    command = [sys.executable, "-m", "tests.tools.recording_cost", "--one", side, "--folder", folder]
    # As the program itself does: a second BLAS thread only spins.
    one_thread = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [*command, "--seconds", str(seconds)], capture_output=True, text=True, check=True, env=one_thread
    )
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def main() -> int:
    """Alternate runs, print both sides and what recording adds."""
    parser = argparse.ArgumentParser(prog="python -m tests.tools.recording_cost", description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--one", choices=("on", "off"), help="one run in this process")
    parser.add_argument("--folder", type=Path)
    options = parser.parse_args()
    if options.one:
        found = asyncio.run(
            run(options.folder, options.folder / "film.avi", options.seconds, recorded=options.one == "on")
        )
        print(json.dumps(found))
        return 0
    with tempfile.TemporaryDirectory() as name:
        make_inputs(Path(name))
        sides, _ = compared(options.repeats, _FIGURES, lambda side: _process(name, options.seconds, side))
    lost = sum(run["rows_lost"] + run["pictures_lost"] for run in sides["on"])
    print(f"rows and pictures lost {lost:g}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
