"""The demo, a scenario and the doctor want nothing that only Linux or Unix has."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

TAKES_AWAY = Path(__file__).with_name("portable")


def elsewhere(module: str, *arguments: str, cwd: Path) -> str:
    """What a program prints where those modules, signals and sockets are missing; its child processes miss them, too."""
    done = subprocess.run(
        [sys.executable, "-m", module, *arguments],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(TAKES_AWAY)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_they_are_taken_away(tmp_path: Path) -> None:
    script = tmp_path / "tries.py"
    script.write_text("try:\n    import fcntl\nexcept ImportError:\n    print('gone')\n")
    assert elsewhere("tries", cwd=tmp_path).split() == ["gone"]


def test_the_demo_runs_without_them(tmp_path: Path) -> None:
    told = json.loads(elsewhere("hilbridge", "demo", "--seconds", "3", "--json", cwd=tmp_path))
    assert told["ticks"] > 0
    assert Path(tmp_path, told["report"]).is_file()


def test_a_scenario_and_the_doctor_run_without_them(tmp_path: Path) -> None:
    assert json.loads(elsewhere("hilscenario.cli", "run", "catalog/bus-cut.yaml", "--json", cwd=tmp_path))["passed"]
    assert "not offered here" in elsewhere("hilbridge", "doctor", cwd=tmp_path)
