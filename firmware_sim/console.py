"""The terminal of `firmware-sim`: commands in, lines out. It never stops for a terminal, nor ends for a closed one."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import IO

_LOOK_AGAIN_S = 0.5


def say(text: str, *, wrong: bool = False, program: str = "firmware-sim") -> None:
    """One line; where nobody can read it any more the program goes on."""
    with contextlib.suppress(OSError, ValueError):
        if wrong:
            print(f"{program}: {text}", file=sys.stderr, flush=True)  # noqa: T201
        else:
            print(f"{program} {text}", flush=True)  # noqa: T201


def listen(
    source: IO[str] | None, take: Callable[[str], None], *, interactive: bool, ended: Callable[[], None]
) -> None:
    """Hand over each line of `source` until its end. A terminal is read only when asked for and in the foreground.

    A background job that reads its terminal is stopped by the system, and a stopped device is no device.
    """
    if source is None:
        return
    terminal = source.isatty()
    if terminal and not interactive:
        return
    while True:
        try:
            if terminal and not _in_foreground(source):
                time.sleep(_LOOK_AGAIN_S)
                continue
            line = source.readline()
        except OSError:  # sent to the background while it waited for a line
            time.sleep(_LOOK_AGAIN_S)
            continue
        except ValueError:  # closed
            line = ""
        if not line:
            ended()
            return
        if line.strip():
            take(line)


def _in_foreground(source: IO[str]) -> bool:
    return os.tcgetpgrp(source.fileno()) == os.getpgrp()


def read_terminal_politely() -> None:
    """Reading a terminal from the background is to fail, not to stop the program; odd bytes are no end either."""
    if hasattr(signal, "SIGTTIN"):
        signal.signal(signal.SIGTTIN, signal.SIG_IGN)
    reconfigure = getattr(sys.stdin, "reconfigure", None)
    if reconfigure is not None:
        reconfigure(errors="replace")


def report_defect(error: BaseException) -> int:
    """What nobody foresaw: its trace into a file, one line with the file's name. Returns the exit code."""
    trace = "".join(traceback.format_exception(error))
    try:
        descriptor, name = tempfile.mkstemp(prefix="firmware-sim-", suffix=".log")
        with os.fdopen(descriptor, "w", encoding="utf-8") as log:
            log.write(trace)
        kept = f"the trace is in {name}"
    except OSError as unwritten:
        kept = f"the trace could not be kept ({unwritten.strerror})"
    where = traceback.extract_tb(error.__traceback__)[-1:]
    place = f" at {Path(where[0].filename).name}:{where[0].lineno}" if where else ""
    text = " ".join(f"{type(error).__name__}: {error}".split())
    say(f"defect: {text}{place}; please report it, {kept}", wrong=True)
    return 1
