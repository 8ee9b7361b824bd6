"""Real-time scheduling where the system allows it, as a real controller has it."""

from __future__ import annotations

import gc
import os
import sys

_PRIORITY = 20


def use_realtime_scheduling() -> bool:
    """Ask for round-robin real-time scheduling of this process; False where it is not allowed (no harm done).

    Linux grants it to root and to processes with an rtprio limit. The kernel keeps 5 % of the time for all others, so
    a process that runs away can still be stopped. Whatever the answer, what this process consists of by now is never
    garbage-collected again: a full collection looks at every object, and no tick comes meanwhile (decision 020).
    """
    gc.freeze()
    if sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2:  # on a single processor nobody else would run
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_PRIORITY))
    except OSError:
        return False
    return True
