"""Which tests run through which line, and how long each takes: what a mutant of that line is given to."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from tests.safety.tools.mutants import Mutant

ROOT = Path(__file__).parents[3]
TESTS = ("tests/firmware_sim", "tests/core", "tests/wire")


class Baseline(NamedTuple):
    """Which tests run through which line of which file, and how long each takes."""

    lines: dict[str, dict[int, set[str]]]
    seconds: dict[str, float]


def baseline() -> Baseline:
    """Run all tests once, recording per line who runs through it. Raises RuntimeError when they do not pass."""
    from coverage import CoverageData

    with tempfile.TemporaryDirectory() as folder:
        data_file = Path(folder) / "coverage"
        command = [sys.executable, "-m", "pytest", *TESTS, "-q", "-p", "no:cacheprovider", "--cov=firmware_sim"]
        command += ["--cov=hilbridge.core", "--cov=hilbridge.wire", "--cov-context=test", "--cov-report="]
        command += ["--durations=0", "--durations-min=0", "-vv", "--hypothesis-seed=0"]
        environment = os.environ | {"COVERAGE_FILE": str(data_file), "PYTHONPATH": str(ROOT), "COLUMNS": "400"}
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise RuntimeError(f"tests fail without any mutation:\n{done.stdout[-2000:]}")
        seconds: dict[str, float] = {}
        for found in re.finditer(r"^([0-9.]+)s (?:call|setup)\s+(\S.*)$", done.stdout, re.M):
            seconds[found[2].strip()] = seconds.get(found[2].strip(), 0.0) + float(found[1])
        data = CoverageData(str(data_file))
        data.read()
        lines: dict[str, dict[int, set[str]]] = {}
        for name in data.measured_files():
            relative = str(Path(name).relative_to(ROOT))
            lines[relative] = {
                line: {context.split("|")[0] for context in contexts if context}
                for line, contexts in data.contexts_by_lineno(name).items()
            }
    return Baseline(lines, seconds)


def chosen_tests(target: str, mutant: Mutant, known: Baseline, looking: tuple[str, ...]) -> tuple[list[str], bool]:
    """Tests that run through the mutant's line, quickest first; `looking` says which where it runs at import (the flag).

    A test that imports a file anew runs through the module's lines, and need not look at them."""
    tests = known.lines.get(target, {}).get(mutant.line, set())
    at_import = not tests and mutant.place == "function"
    if not tests or mutant.place != "function":
        tests = tests | {test for test in known.seconds if test.split("::")[0].endswith(looking)}
    return sorted(tests, key=lambda test: (known.seconds.get(test, 0.0), test)), at_import


def quickest(tests: list[str], known: Baseline, limit_s: float) -> list[str]:
    """The first of these, as many as take so long together, and one at least."""
    spent_s, taken = 0.0, list[str]()
    for test in tests:
        spent_s += known.seconds.get(test, 0.0)
        if taken and spent_s > limit_s:
            break
        taken.append(test)
    return taken
