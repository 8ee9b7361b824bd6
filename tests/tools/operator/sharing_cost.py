"""What sharing pictures with the operator's page adds to a tick: `python -m tests.tools.operator.sharing_cost`.

The same recorded run at 720p30 with a device, shared and not. Where it is shared, a monitor serves the picture to a client
that takes ten a second. Each run is a process of its own; the order alternates, and of each figure the least of the repeats
counts, since this machine may have other work.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path

from hilbridge.config import BusConfig, Config, MonitorConfig, SensorsConfig
from hilbridge.demo import DeviceProcess
from hilbridge.observe.reading import read_recording
from hilbridge.observe.summary import percentile
from hilbridge.rows import TickRow
from hilbridge.run import RunOptions, run_bridge
from hilbridge.runtime.assemble import read_parts
from hilbridge.runtime.senses import open_senses
from tests.system.operator.rig import monitor
from tests.tools.recording_cost import FPS, compared, make_inputs

LIMIT_MS = 1.0
_FIGURES = ("cpu_percent", "tick_work_p99_ms", "tick_jitter_p99_ms")


class _Silent:
    """Nobody looks on."""

    def tick(self, seconds: float, row: TickRow) -> None:
        """Not shown."""

    def notice(self, text: str) -> None:
        """Not shown."""

    def over(self, text: str) -> None:
        """Not shown."""


def one(folder: Path, seconds: float, *, shared: bool, bus: str) -> dict[str, float]:
    """One run in this process; its figures."""
    sensors = SensorsConfig(
        camera=str(folder / "film.avi"), camera_fps=FPS, gaze=str(folder / "gaze.csv"), hands=False, loop=True
    )
    config = Config(sensors=sensors, bus=BusConfig(spec=bus), monitor=MonitorConfig(share_pictures=shared))
    out = Path(tempfile.mkdtemp(dir=folder))
    asyncio.run(
        run_bridge(config, read_parts(config), open_senses(sensors), out, RunOptions("cost", seconds), _Silent())
    )
    ticks = [row for row in read_recording(out, (TickRow.topic,)) if isinstance(row, TickRow)]
    late_ms = [abs((after.time_ns - before.time_ns) / 1e6 - 40.0) for before, after in pairwise(ticks)]
    times = os.times()
    return {
        "cpu_percent": 100.0 * (times.user + times.system) / seconds,
        "tick_work_p99_ms": percentile([row.work_ms or 0.0 for row in ticks], 0.99) or 0.0,
        "tick_jitter_p99_ms": percentile(late_ms, 0.99) or 0.0,
    }


@contextlib.contextmanager
def client(bus: str) -> Iterator[list[int]]:
    """A monitor and somebody who takes its pictures meanwhile; the sizes of those."""
    sizes: list[int] = []
    over = threading.Event()
    with monitor("--bus", bus) as (url, _):

        def take() -> None:
            number = "0"
            while not over.wait(0.1):
                with urllib.request.urlopen(f"{url}picture?after={number}") as answer:
                    if answer.status == 200:
                        number = json.loads(answer.headers["X-Overlay"])["number"]
                        sizes.append(len(answer.read()))

        thread = threading.Thread(target=take)
        thread.start()
        try:
            yield sizes
        finally:
            over.set()
            thread.join()


def side(folder: Path, name: str, seconds: float) -> dict[str, float]:
    """One run in a process of its own, with a device, with or without a client."""
    bus = f"hilsim:share-{os.getpid()}"
    command = [sys.executable, "-m", "tests.tools.operator.sharing_cost", "--one", name, "--folder", str(folder)]
    command += ["--seconds", str(seconds), "--bus", bus]
    with ExitStack() as stack:
        device = DeviceProcess(bus, folder / "device.jsonl")
        stack.callback(device.stop)
        sizes = stack.enter_context(client(bus)) if name == "on" else []
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # as the program itself does
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    if name == "on":
        found |= {"pictures": len(sizes), "picture_kb": sum(sizes) / max(1, len(sizes)) / 1e3}
    return found


def main() -> int:
    """Alternate runs, print both sides and what sharing adds; exit code 1 where a tick's p99 grows by more than 1 ms."""
    parser = argparse.ArgumentParser(prog="python -m tests.tools.operator.sharing_cost", description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--one", choices=("on", "off"), help="one run in this process")
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--bus", default="")
    options = parser.parse_args()
    if options.one:
        print(json.dumps(one(options.folder, options.seconds, shared=options.one == "on", bus=options.bus)))
        return 0
    with tempfile.TemporaryDirectory() as name:
        make_inputs(Path(name))
        _, adds = compared(options.repeats, _FIGURES, lambda which: side(Path(name), which, options.seconds))
    return int(adds["tick_work_p99_ms"] > LIMIT_MS)


if __name__ == "__main__":
    sys.exit(main())
