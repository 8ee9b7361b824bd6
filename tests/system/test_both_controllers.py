"""Runs in virtual time with the controller in C leave the same bytes behind as with the reference."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from firmware_sim.c import binding

ROOT = Path(__file__).parents[2]


def run(out: Path, controller: str) -> str:
    """The whole catalogue in a process of its own; what it prints."""
    command = [sys.executable, "-m", "hilscenario.cli", "run", str(ROOT / "scenarios" / "catalog"), "--out", str(out)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "HILBRIDGE_CONTROLLER": controller}
    done = subprocess.run(command, env=environment, cwd=out.parent, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.timeout(1200)
@pytest.mark.skipif(not binding.available(), reason="the C controller is not built")
def test_the_catalogue_leaves_the_same_bytes_with_either_controller(tmp_path: Path) -> None:
    for controller in ("python", "c"):
        told = run(tmp_path / controller, controller)
        print(told)
        assert f"controller in {controller}" in " ".join(told.split())
    recordings = sorted(path.name for path in (tmp_path / "python").glob("*.mcap"))
    assert len(recordings) >= 20
    for name in recordings:
        assert (tmp_path / "python" / name).read_bytes() == (tmp_path / "c" / name).read_bytes(), name
