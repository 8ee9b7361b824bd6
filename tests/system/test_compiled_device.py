"""`hilscenario compile`: the compiled device leaves the same bytes behind as the sources do."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hilbridge.errors import InputError
from scenarios.lockstep import compiled

ROOT = Path(__file__).parents[2]
# A predictor's minute, a fault on the bus, one of the device, a wearer against the assist.
SCENARIOS = ("an-ordinary-minute", "device-sensor-fault", "bus-stale-queue", "wearer-opposes")


def run(out: Path, first: Path | None) -> str:
    """The same scenarios in a process of its own, with `first` before the sources on the path; what it prints."""
    path = os.pathsep.join([*([] if first is None else [str(first)]), str(ROOT)])
    files = [str(ROOT / "scenarios" / "catalog" / f"{name}.yaml") for name in SCENARIOS]
    command = [sys.executable, "-m", "scenarios.cli", "run", *files, "--out", str(out)]
    done = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": path}, cwd=out.parent, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.timeout(1200)
@pytest.mark.skipif(shutil.which("cc") is None and shutil.which("gcc") is None, reason="no C compiler")
def test_the_compiled_device_leaves_the_same_bytes(tmp_path: Path) -> None:
    fast = compiled.compile_device(tmp_path / "fast")
    assert "compiled device" not in run(tmp_path / "slow-out", None)
    told = run(tmp_path / "fast-out", fast)
    print(told)
    assert "compiled device" in told
    recordings = sorted(path.name for path in (tmp_path / "slow-out").glob("*.mcap"))
    assert len(recordings) == len(SCENARIOS)
    for name in recordings:
        assert (tmp_path / "slow-out" / name).read_bytes() == (tmp_path / "fast-out" / name).read_bytes(), name


@pytest.mark.parametrize("inside", ["thesis.tex", "firmware_sim/controller.py"])
def test_a_folder_of_something_else_is_not_emptied(tmp_path: Path, inside: str) -> None:
    """Least of all the sources' own."""
    (tmp_path / inside).parent.mkdir(exist_ok=True)
    (tmp_path / inside).write_text("years of work")
    with pytest.raises(InputError, match="not made by this command"):
        compiled.compile_device(tmp_path)
    assert (tmp_path / inside).exists()


def test_no_compiler_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(InputError, match="needs a C compiler; install gcc"):
        compiled.compile_device(tmp_path / "out")
