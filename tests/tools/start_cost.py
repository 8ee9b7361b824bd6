"""What `hilbridge run` costs until its first command is on the bus, without hands: `python -m tests.tools.start_cost`.

A made film at 720p and a gaze in CSV, the simulated bus with a device on it already. Each run is a process of its own; the
least of the repeats counts, since this machine may have other work. Memory is the kernel's largest resident size of it.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

from hilbridge.demo import DeviceProcess
from hilbridge.observe.reading import read_recording
from hilbridge.rows import CanRow, Direction
from tests.tools.recording_cost import make_inputs

_ACT_CMD = 0x060


def once(folder: Path, bus: str, number: int) -> tuple[float, float]:
    """Seconds to the first ACT_CMD, and megabytes."""
    out = folder / f"run-{number}"
    command = [str(Path(sys.executable).with_name("hilbridge")), "run", "--camera", str(folder / "film.avi"), "--gaze"]
    command += [str(folder / "gaze.csv"), "--no-hands", "--bus", bus, "--seconds", "2", "--out", str(out), "--json"]
    begin_ns = time.monotonic_ns()
    silent = [
        (os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0),
        (os.POSIX_SPAWN_OPEN, 2, os.devnull, os.O_WRONLY, 0),
    ]
    child = os.posix_spawn(command[0], command, os.environ, file_actions=silent)
    _, status, usage = os.wait4(child, 0)
    if status:
        raise SystemExit(f"hilbridge run ended with {os.waitstatus_to_exitcode(status)}")
    for row in read_recording(out, (CanRow.topic,)):
        if isinstance(row, CanRow) and row.direction is Direction.TX and row.can_id == _ACT_CMD:
            return (row.time_ns - begin_ns) / 1e9, usage.ru_maxrss / 1e3
    raise SystemExit("no command was sent")


def main() -> int:
    """Print the figures; exit code 1 where they are not what they have to be."""
    parser = argparse.ArgumentParser(prog="python -m tests.tools.start_cost", description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    repeats = parser.parse_args().repeats
    bus = f"hilsim:start-{os.getpid()}"
    with tempfile.TemporaryDirectory() as name:
        make_inputs(Path(name))
        device = DeviceProcess(bus, Path(name) / "device.jsonl")
        try:
            found = [once(Path(name), bus, number) for number in range(repeats)]
        finally:
            device.stop()
    seconds, megabytes = min(one[0] for one in found), max(one[1] for one in found)
    each = ", ".join(f"{one[0]:.2f}" for one in found)
    print(f"start to first command {seconds:.2f} s (each: {each}), {megabytes:.0f} MB at most")
    return int(seconds > 1.0 or megabytes > 200.0)


if __name__ == "__main__":
    sys.exit(main())
