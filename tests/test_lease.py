import subprocess
import sys

import pytest

from hilbridge.lease import leased, run_leased


def test_what_a_program_says_and_returns_comes_through():
    done = run_leased([sys.executable, "-c", "import sys; print('out'); print('err', file=sys.stderr); sys.exit(3)"])
    assert (done.returncode, done.stdout, done.stderr) == (3, "out\n", "err\n")


@pytest.mark.skipif(sys.platform == "win32", reason="needs process groups")
def test_a_terminated_keeper_ends_what_it_keeps_and_what_that_started():
    grandchild = "import subprocess, sys; print('up', flush=True); subprocess.run([sys.executable, '-c', 'input()'])"
    keeper = subprocess.Popen(
        leased([sys.executable, "-c", grandchild]), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with keeper:
        assert keeper.stdout is not None
        assert keeper.stdout.readline() == "up\n"
        keeper.terminate()
        assert keeper.stdout.read() == ""  # the pipe is closed by all who held it
    assert keeper.returncode == 1


def test_without_its_parent_a_keeper_keeps_nothing():
    keeper = subprocess.run(
        [sys.executable, "-m", "hilbridge.lease", "1", sys.executable, "-c", "input()"], check=False
    )
    assert keeper.returncode == 1
