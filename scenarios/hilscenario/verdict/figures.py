"""Figures of a run: counts, rates and times, each with one definition."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hilbridge.core.gate_figures import GateTick, gate_figures
from hilbridge.rows import TickRow
from hilscenario.signals.trace import Trace


def figures_of_ticks(ticks: Sequence[TickRow]) -> dict[str, float]:
    """acts, holds, coverage, act_only_precision (NaN without any known) and false_assists_per_min of the bridge's rows."""
    gate = gate_figures(GateTick(row.verb, row.right) for row in ticks)
    seconds = (ticks[-1].time_ns - ticks[0].time_ns) / 1e9 if ticks else 0.0
    return {
        "acts": float(gate.acts),
        "holds": float(gate.holds),
        "coverage": gate.coverage,
        "act_only_precision": math.nan if gate.act_only_precision is None else gate.act_only_precision,
        "false_assists_per_min": gate.false_assists_per_min(seconds),
    }


def zero_after_fault_ms(trace: Trace) -> float:
    """The longest time from a fault's begin under assist until assist is exactly zero; 0 where none began then."""
    zero = np.asarray(trace["device.assist_zero"], np.float64) != 0.0
    faults = [name for name in trace.values if name.startswith("fault.") and name != "fault.any"]
    longest = 0.0
    for name in faults:
        begins = _rises(np.asarray(trace[name], np.float64) != 0.0)
        for begin in begins:
            if zero[begin]:
                continue
            later = np.flatnonzero(zero[begin:])
            longest = max(longest, float(later[0] if len(later) else trace.length - begin) * trace.step_ms)
    return longest


def _rises(level: NDArray[np.bool_]) -> NDArray[np.intp]:
    return np.flatnonzero(level[1:] & ~level[:-1]) + 1


def assist_rise_nm_s(trace: Trace) -> NDArray[np.float64]:
    """How fast |assist| rises, N m/s over 5 ms (the controller's grid and the trace's differ by up to one tick)."""
    assist = np.abs(np.asarray(trace["device.assist_nm"], np.float64))
    span = 5
    rise = np.zeros_like(assist)
    rise[span:] = np.maximum(0.0, assist[span:] - assist[:-span]) / (span * trace.step_ms * 1e-3)
    # Five steps of the grid may hold six ticks of a device whose clock is fast.
    return rise * span / (span + 1)
