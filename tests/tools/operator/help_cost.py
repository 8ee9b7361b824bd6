"""What `hilbridge --help` and each command's help cost: `python -m tests.tools.operator.help_cost`.

Seconds from start to end, and of the processor. The least of the repeats counts, since this machine may have other work.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

from hilbridge.cli import app
from hilbridge.cli_shared import commands

LIMIT_S = 0.3


def once(words: list[str]) -> tuple[float, float]:
    """Seconds on the clock and of the processor."""
    command = [str(Path(sys.executable).with_name("hilbridge")), *words, "--help"]
    silent = [(os.POSIX_SPAWN_OPEN, descriptor, os.devnull, os.O_WRONLY, 0) for descriptor in (1, 2)]
    begin_s = time.perf_counter()
    child = os.posix_spawn(command[0], command, os.environ, file_actions=silent)
    _, status, usage = os.wait4(child, 0)
    if status:
        raise SystemExit(f"{' '.join(command)} ended with {os.waitstatus_to_exitcode(status)}")
    return time.perf_counter() - begin_s, usage.ru_utime + usage.ru_stime


def main() -> int:
    """Print the figures; exit code 1 where the first is not what it has to be."""
    parser = argparse.ArgumentParser(prog="python -m tests.tools.operator.help_cost", description=__doc__)
    parser.add_argument("--repeats", type=int, default=10)
    parser.add_argument("--all", action="store_true", help="every command's help, too")
    options = parser.parse_args()
    asked = ["", *(name for name, _ in commands(app))] if options.all else [""]
    wall_s = 0.0
    for name in asked:
        found = [once(name.split()) for _ in range(options.repeats)]
        least = min(one[0] for one in found)
        wall_s = wall_s or least
        print(f"hilbridge {name:24} {least:.2f} s, of the processor {min(one[1] for one in found):.2f} s")
    return int(wall_s > LIMIT_S)


if __name__ == "__main__":
    sys.exit(main())
