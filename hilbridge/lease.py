"""A child process that ends with its parent, however the parent ends: kill -9 and a power-hungry kernel among it."""

from __future__ import annotations

import os
import threading
import time

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
