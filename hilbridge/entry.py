"""The very beginning of a program. Until its guard stands, Ctrl-C ends it at once: an import has nothing to close or to say."""

from __future__ import annotations

import importlib
import signal


def start(module: str) -> None:
    """Import a command line and run its `main`, whose guard (`hilbridge.guard`) takes Ctrl-C over."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not where whoever started us ignores it
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    importlib.import_module(module).main()
