"""The tutorial, step by step, as somebody follows it who has nothing but its words (and has installed the program)."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "tutorial.md"
_BLOCK = re.compile(r"^```(sh|yaml)\n(.*?)^```", re.DOTALL | re.MULTILINE)
_INSTALLS = "pip install"


def test_every_step_does_what_the_page_says(tmp_path: Path) -> None:
    said = []
    for language, block in _BLOCK.findall(PAGE.read_text(encoding="utf-8")):
        if language == "yaml":
            (tmp_path / "mine.yaml").write_text(block)
        elif _INSTALLS in block:
            steps = block.split(_INSTALLS)[1].splitlines()[1:]
            said.append(shell("\n".join(steps), tmp_path))
        else:
            said.append(shell(block, tmp_path))
    demo, looked, shipped, failing, passing = said
    assert "act-only precision" in demo
    assert (tmp_path / "out" / "demo" / "report.html").is_file()
    assert (tmp_path / "out" / "demo" / "bus.log").stat().st_size > 10_000
    assert "ticks" in looked
    assert "1 of 1 passed" in shipped
    assert "it failed" in failing
    assert "zero_after_fault_ms" in failing
    assert "1 of 1 passed" in passing


def shell(text: str, cwd: Path) -> str:
    """What the steps print; the programs are those beside this interpreter."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["sh", "-e", "-c", text],
        cwd=cwd,
        env={**os.environ, "PATH": path, "COLUMNS": "200"},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, f"{text}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
    return done.stdout
