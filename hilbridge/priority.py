"""Real-time scheduling where the system allows it, so that a busy machine does not make ticks late.

Linux grants it to root and to processes with an rtprio limit. The process of a simulated bus comes first, it stands for
a wire; then the tick, then what stamps the sensors, then the pictures' long computations, then the recording. That one
comes last, but before everything ordinary: while another program has its processor, it may hold the interpreter's lock,
for which the tick would wait. The operator's page, a process of its own, comes even after that: it passes a STOP on
without waiting for what is ordinary, and is never in the bridge's way. The kernel keeps 5 % of the time for all others,
so a process that runs away can still be stopped.

Python's garbage collector is kept short as well: a full collection looks at every object, with the libraries' own about
90,000 of them, and no tick comes meanwhile (decision 020).
"""

from __future__ import annotations

import gc
import os
import sys
from enum import IntEnum


class Level(IntEnum):
    """Real-time priorities; higher runs first."""

    ORDINARY = 0
    PAGE = 1
    RECORDING = 2
    VISION = 5
    SENSORS = 10
    TICK = 15
    BUS = 20


class _Granted:
    """Whether this process runs in real time; set once, read by every thread as it starts."""

    value = False


def use_realtime_scheduling(level: Level = Level.TICK) -> bool:
    """Put the calling thread at the tick's level (or another), and let others take theirs; False where not allowed.

    On a single processor it would only keep the other end of the bus from running, so there it is left alone.
    Whatever the answer, what this process consists of by now is never collected again: call it before the loop.
    """
    gc.freeze()
    _Granted.value = _processors() > 1 and _schedule(level)
    return _Granted.value


def _processors() -> int:
    """Those that this process may use: `taskset` or a container may leave it one of many."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def take_level(level: Level) -> None:
    """Put the calling thread at a level of its own, whatever thread it was started from; nothing without real time."""
    if _Granted.value:
        _schedule(level)


def _schedule(level: Level) -> bool:
    if sys.platform != "linux":
        return False
    policy = os.SCHED_OTHER if level is Level.ORDINARY else os.SCHED_RR
    try:
        os.sched_setscheduler(0, policy, os.sched_param(int(level)))
    except OSError:
        return False
    return True
