"""The device's own part, in a process of its own: it knows its profiles, their limits and the arm. They share no code."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hilbridge.errors import InputError
from hilbridge.lease import leased
from hilbridge.tune.motion import Motion

COMMAND = ("-m", "firmware_sim.tuning.process")
CONTROLS = ("steady", "weak", "ataxic")


@dataclass(frozen=True, slots=True)
class Asked:
    """profiles: the file to start from, None for the one that ships. control: how the wearer moves. cuff_nm_rad: None: usual"""

    profiles: Path | None = None
    control: str = "steady"
    cuff_nm_rad: float | None = None


@dataclass(frozen=True, slots=True)
class Profiles:
    """What the device proposes: a row a section of its file, the file before and after, and the hashes of both."""

    rows: tuple[dict[str, Any], ...]
    old_text: str
    new_text: str
    old_hash: str
    new_hash: str


def propose(asked: Asked, motions: Sequence[Motion], progress: Callable[[int], Callable[[], None]]) -> Profiles:
    """Ask it. `progress` is told how many trials there are at most and gives what to call after each. Raises InputError."""
    if asked.control not in CONTROLS:
        raise InputError(f"--control {asked.control}: there are {', '.join(CONTROLS)}")
    request = {
        "profiles": None if asked.profiles is None else str(asked.profiles),
        "control": asked.control,
        "cuff_nm_rad": asked.cuff_nm_rad,
        "recordings": [{"t_s": one.t_s.tolist(), "acceleration": one.acceleration.tolist()} for one in motions],
    }
    with subprocess.Popen(
        leased([sys.executable, *COMMAND]),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            return _told(process, json.dumps(request), progress)
        except BaseException:
            process.terminate()
            raise


def _told(process: subprocess.Popen[str], request: str, progress: Callable[[int], Callable[[], None]]) -> Profiles:
    assert process.stdin is not None
    assert process.stdout is not None
    assert process.stderr is not None
    try:
        process.stdin.write(request)
        process.stdin.close()
    except BrokenPipeError:
        pass  # it has ended, and says why
    step: Callable[[], None] = lambda: None  # noqa: E731
    for line in process.stdout:
        said = json.loads(line)
        if "of" in said:
            step = progress(said["of"])
        elif "tried" in said:
            step()
        elif "error" in said:
            raise InputError(f"{said['error']}")
        elif "result" in said:
            found = said["result"]
            return Profiles(
                tuple(found["profiles"]), found["old_text"], found["new_text"], found["old_hash"], found["new_hash"]
            )
    last = process.stderr.read().strip().splitlines()
    raise RuntimeError(f"the trials ended early: {last[-1] if last else 'nothing was said'}")
