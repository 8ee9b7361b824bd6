"""entry: Ctrl-C before the guard stands ends a program without a word; the guard takes it over."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

SLOW = "import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n"
GUARDED = """
import os, signal
from hilbridge.guard import guarded
def main():
    raise SystemExit(guarded(lambda: os.kill(os.getpid(), signal.SIGINT), "it"))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="there Ctrl-C is no signal that can be sent to one process")
@pytest.mark.parametrize(("module", "code", "said"), [(SLOW, -signal.SIGINT, ""), (GUARDED, 130, "it: interrupted\n")])
def test_an_interrupt_shows_no_trace_at_any_time(tmp_path: Path, module: str, code: int, said: str) -> None:
    (tmp_path / "made.py").write_text(module)
    program = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from hilbridge.entry import start; start('made')"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (code, said)
