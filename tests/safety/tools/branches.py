"""100 % branch coverage of what decides about safety, by the tests of its own rooms."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.safety.mutation import ROOT, TARGETS
from tests.safety.table import REFERENCE, Row, Scale
from tests.safety.tools.baseline import TESTS


def run(scale: Scale) -> list[Row]:
    """Both scales are the same run."""
    del scale
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "coverage.json"
        command = [sys.executable, "-m", "pytest", *TESTS, "-q", "-p", "no:cacheprovider", "--cov-branch"]
        command += ["--cov=firmware_sim", "--cov=hilbridge.core", "--cov=hilbridge.wire", f"--cov-report=json:{report}"]
        environment = (
            os.environ | REFERENCE | {"COVERAGE_FILE": str(Path(folder) / "coverage"), "PYTHONPATH": str(ROOT)}
        )
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            print(*(line for line in done.stdout.splitlines() if line.startswith("FAILED")), sep="\n", file=sys.stderr)
            return [Row("branches", "the tests themselves pass", done.stdout.strip().splitlines()[-1], False)]
        files = json.loads(report.read_text())["files"]
    found, missing = 0, []
    for target in TARGETS:
        summary = files[target]["summary"]
        found += summary["num_branches"]
        if summary["missing_branches"] or summary["missing_lines"]:
            missing.append(target)
    figure = f"{found} branches in {len(TARGETS)} files, " + (
        f"missing in {', '.join(missing)}" if missing else "all taken"
    )
    return [Row("branches", "100 % of lines and branches of the files mutated", figure, not missing)]
