"""A child process that ends with its parent, however the parent ends: kill -9 and a power-hungry kernel among it."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path

_LOOK_S = 0.25


class _Watched:
    """The parent that this process watches already, 0 for none: a worker is told again with every task."""

    parent = 0


def end_with(parent: int) -> None:
    """End this process at once when process `parent`, which has started it, is gone. Within `parent` it does nothing."""
    if parent in (os.getpid(), _Watched.parent):
        return
    _Watched.parent = parent
    threading.Thread(target=_watch, args=(parent,), name="lease", daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_LOOK_S)
    os._exit(1)


def leased(command: list[str]) -> list[str]:
    """`command` under a keeper that ends it, and all that it has started, when this process is gone.

    For programs that are not ours: a compiler, pip. The exit code is theirs. To end it, terminate it: a keeper that is
    killed keeps nothing.
    """
    return [sys.executable, "-m", "hilbridge.lease", str(os.getpid()), *command]


def run_leased(
    command: list[str], cwd: Path | None = None, env: Mapping[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run `command` under a lease to its end and take what it prints. Ctrl-C ends it too."""
    with subprocess.Popen(
        leased(command), cwd=cwd, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as keeper:
        try:
            said, errors = keeper.communicate()
        except BaseException:
            keeper.terminate()
            raise
    return subprocess.CompletedProcess(command, keeper.returncode, said, errors)


def _keep(parent: int, command: list[str]) -> int:
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # an exit runs what stands in `finally`
    child = subprocess.Popen(command, start_new_session=True)
    try:
        while os.getppid() == parent:
            with contextlib.suppress(subprocess.TimeoutExpired):
                return child.wait(_LOOK_S)
    finally:
        if child.poll() is None:
            _end_group(child)
    return 1


def _end_group(leader: subprocess.Popen[bytes]) -> None:
    if hasattr(os, "killpg"):
        os.killpg(leader.pid, signal.SIGKILL)
    else:
        leader.kill()


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        sys.exit(_keep(int(sys.argv[1]), sys.argv[2:]))
