"""Every way out of a command is one line and an exit code."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys

import pytest
import typer

from hilbridge.errors import InputError
from hilbridge.guard import guarded, sure_to_end


def raising(error: BaseException) -> int:
    def command() -> None:
        raise error

    return guarded(command, "prog")


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (InputError("bus x: two\nlines; cure"), 2, "prog: bus x: two lines; cure"),
        (
            OSError(errno.ENOSPC, "No space left on device", "a.mcap"),
            2,
            "a.mcap: No space left on device; free some space",
        ),
        (PermissionError(errno.EACCES, "Permission denied", "b"), 2, "b: Permission denied"),
        (BrokenPipeError(errno.EPIPE, "Broken pipe"), 1, "standard output was closed"),
        (ExceptionGroup("tasks", [InputError("inner")]), 2, "prog: inner"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (typer.Abort(), 130, "interrupted"),
        (MemoryError(), 2, "not enough memory"),
        (KeyError("verb"), 1, "defect: KeyError: 'verb' at test_guard.py:"),
        (RecursionError("deep"), 1, "defect: RecursionError"),
    ],
)
def test_one_line_and_its_code(error: BaseException, code: int, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert raising(error) == code
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert said in line
    if "the trace is in" in line:
        name = line.rsplit(" ", 1)[1].strip()
        assert os.path.getsize(name)  # noqa: PTH202
        os.unlink(name)  # noqa: PTH108


def test_what_was_saved_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    error = BrokenPipeError(errno.EPIPE, "Broken pipe")
    error.add_note("saved: out/run/recording.mcap")
    assert raising(error) == 1
    assert capsys.readouterr().err.endswith("; saved: out/run/recording.mcap\n")


def test_codes_of_commands_are_their_own() -> None:
    assert guarded(lambda: None, "prog") == 0
    assert guarded(lambda: 1, "prog") == 1
    assert raising(SystemExit(3)) == 3


def test_ctrl_c_works_as_before_after_a_command_that_failed() -> None:
    before = signal.getsignal(signal.SIGINT)
    assert raising(InputError("no such file")) == 2
    assert signal.getsignal(signal.SIGINT) is before


_LOSES = """
import os, signal, sys
from hilbridge.guard import guarded, sure_to_end, sure_to_end

def command():
    with sure_to_end("prog", 0.1):
        while True:
            try:
                os.kill(os.getpid(), signal.SIGINT)
                signal.pause()
            except KeyboardInterrupt:
                pass

sys.exit(guarded(command, "prog"))
"""


def test_work_that_loses_an_interrupt_ends_all_the_same() -> None:
    done = subprocess.run([sys.executable, "-c", _LOSES], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (130, "prog: interrupted\n")


_WAITS_AT_ITS_END = """
import atexit, os, signal, sys, threading
from hilbridge.guard import guarded, sure_to_end

atexit.register(threading.Event().wait)

def command():
    with sure_to_end("prog", 0.1):
        os.kill(os.getpid(), signal.SIGINT)
        signal.pause()

sys.exit(guarded(command, "prog"))
"""


def test_work_that_waits_for_its_children_at_the_end_ends_all_the_same() -> None:
    command = [sys.executable, "-c", _WAITS_AT_ITS_END]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 130
    assert done.stderr.splitlines()[0] == "prog: interrupted"


def test_a_loop_without_an_interrupt_leaves_the_handler_as_it_was() -> None:
    before = signal.getsignal(signal.SIGINT)
    with sure_to_end("prog", 0.1):
        assert signal.getsignal(signal.SIGINT) is not before
    assert signal.getsignal(signal.SIGINT) is before
