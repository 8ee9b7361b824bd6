"""What only a board can have: an AES engine of its own that is wrong, limits of its own that are not valid."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

HOME = Path(__file__).parents[3] / "firmware_sim" / "c"


@pytest.mark.skipif(shutil.which("gcc") is None, reason="not installed: gcc")
def test_a_wrong_engine_or_wrong_limits_latch_at_the_self_test(tmp_path: Path) -> None:
    program = tmp_path / "spoilt"
    sources = [*sorted(HOME.glob("ctl_*.c")), HOME / "tools" / "spoilt.c"]
    subprocess.run(["gcc", "-std=c11", "-Wall", "-Werror", "-DCTL_OWN_AES", *sources, "-o", str(program)], check=True)
    told = subprocess.run([str(program)], capture_output=True, text=True, check=False)
    assert told.returncode == 0, told.stdout
