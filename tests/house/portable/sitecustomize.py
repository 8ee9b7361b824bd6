"""Loaded at the start of every process of a test: takes away what only Unix has, as far as Python itself lives without."""

import asyncio
import asyncio.unix_events
import signal
import socket
import subprocess
import sys

# What the standard library itself needs here stays with it; what asks for it by name from now on is refused.
_ONLY_UNIX = ("fcntl", "termios", "tty", "pty", "resource", "pwd", "grp", "syslog", "curses", "readline", "crypt")
assert subprocess
for _name in _ONLY_UNIX:
    sys.modules[_name] = None  # type: ignore[assignment]  # "import of NAME halted", which is an ImportError
for _module, _names in (
    (signal, ("SIGQUIT", "SIGUSR1", "SIGUSR2", "SIGHUP", "SIGALRM", "SIGTSTP", "setitimer")),
    (socket, ("AF_CAN", "CAN_RAW", "SO_REUSEPORT")),
):
    for _name in _names:
        if hasattr(_module, _name):
            delattr(_module, _name)


def _no_signals(*_: object) -> None:
    raise NotImplementedError


asyncio.unix_events._UnixSelectorEventLoop.add_signal_handler = _no_signals  # type: ignore[method-assign]
asyncio.unix_events._UnixSelectorEventLoop.remove_signal_handler = _no_signals  # type: ignore[method-assign,assignment]
