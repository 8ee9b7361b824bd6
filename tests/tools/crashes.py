"""Ends a live run with camera in every ugly way, and looks at what its recording still holds.

`python -m tests.tools.crashes --kills 50` is the long version of tests/system/test_recordings_survive.py.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from hilbridge.errors import InputError
from hilbridge.observe.reading import read_recording
from hilbridge.observe.recover import recover
from hilbridge.observe.report import write_report
from hilbridge.replay.again import Options, replay
from hilbridge.rows import ImageRow, TickRow
from tests.scenarios.sessions import film

_PATIENCE_S = 120.0
_MOST_LOST_S = 1.0


@dataclass(frozen=True, slots=True)
class Left:
    """What a run that ended badly left: time from its last row to its end, rows of two kinds, and what lacks."""

    lost_s: float
    ticks: int
    pictures: int
    missing: str | None


def start_run(out: Path, inputs: Path, *more: str) -> subprocess.Popen[str]:
    """A bridge on a made film, on a simulated bus of its own."""
    bus = f"hilsim:crash-{os.getpid()}-{time.monotonic_ns()}"
    command = [sys.executable, "-m", "hilbridge.cli", "run", "--camera", str(inputs / "session.avi"), "--loop"]
    command += ["--gaze", str(inputs / "gaze.csv"), "--no-hands", "--bus", bus, "--out", str(out), "--force", *more]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def await_rows(out: Path, run: subprocess.Popen[str]) -> None:
    """Until the first chunk is on the disk."""
    end_s = time.monotonic() + _PATIENCE_S
    path = out / "recording.mcap"
    while not (path.exists() and path.stat().st_size > 4_000):
        assert run.poll() is None, run.communicate()
        assert time.monotonic() < end_s, "no row within two minutes"
        time.sleep(0.02)


def killed(out: Path, inputs: Path, after_s: float, number: int = signal.SIGKILL) -> Left:
    """Start a run, end it by a signal so long after its first chunk, use every command on what it left."""
    run = start_run(out, inputs)
    await_rows(out, run)
    time.sleep(after_s)
    ended_ns = time.monotonic_ns()
    run.send_signal(number)
    run.communicate(timeout=_PATIENCE_S)
    return left_behind(out, ended_ns)


def left_behind(out: Path, ended_ns: int) -> Left:
    """Open what is left with every command. Raises where one cannot."""
    path = out / "recording.mcap"
    reader = read_recording(path)
    last_ns = ticks = pictures = 0
    for row in reader:
        last_ns = max(last_ns, row.time_ns)
        ticks += isinstance(row, TickRow)
        pictures += isinstance(row, ImageRow)
    assert write_report(path, out / "report.html").missing == reader.missing
    made = recover(path, out / "whole.mcap")
    whole = read_recording(made.path)
    assert sum(1 for _ in whole) == made.rows
    assert whole.missing is None
    for one in (path, made.path):
        difference = replay(one, Options())
        assert difference.ticks == ticks
        assert difference.bit_equal, difference.as_text()
    return Left((ended_ns - last_ns) / 1e9, ticks, pictures, reader.missing)


@contextlib.contextmanager
def small_disk(folder: Path, megabytes: float) -> Iterator[Path]:
    """A file system that is soon full. Raises InputError where only root may have one."""
    folder.mkdir()
    size = f"size={round(megabytes * 1024)}k"
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", size, "tmpfs", str(folder)], capture_output=True, check=False)
    if done.returncode:
        raise InputError(f"{folder}: no tmpfs may be mounted here")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def main() -> int:
    """Many random instants, one line each; exit 1 where more than a second was lost."""
    parser = argparse.ArgumentParser(prog="python -m tests.tools.crashes", description=__doc__)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    chance = random.Random(options.seed)
    found: list[Left] = []
    with tempfile.TemporaryDirectory() as folder:
        film(Path(folder))
        for number in range(options.kills):
            left = killed(Path(folder) / f"run-{number}", Path(folder), chance.uniform(0.0, 3.0))
            found.append(left)
            print(
                f"{number + 1:3d}  {left.lost_s:.3f} s lost, {left.ticks} ticks, {left.pictures} pictures", flush=True
            )
    worst_s = max(left.lost_s for left in found)
    print(f"{len(found)} killed, every file opened by every command, {worst_s:.3f} s lost at most")
    return 0 if worst_s <= _MOST_LOST_S else 1


if __name__ == "__main__":
    sys.exit(main())
