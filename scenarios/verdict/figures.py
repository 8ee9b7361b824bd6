"""Figures of a run: counts, rates and times, each with one definition."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenarios.signals.trace import Trace

TICK_S = 0.04


def gate_figures(ticks: Sequence[Mapping[str, Any]], seconds: float) -> dict[str, float]:
    """From the bridge's 25 Hz rows.

    acts, holds: switches to ACT, and to HOLD (the hold it starts in counts). coverage: share of ticks in ACT;
    act_only_precision: share of these whose verb is the wearer's, NaN without any of which that is known.
    false_assists_per_min: ACT episodes that begin with a wrong verb, a minute.
    """
    actions = [row["action"] for row in ticks]
    begins = [index for index, action in enumerate(actions) if index == 0 or actions[index - 1] != action]
    acting = [row for row in ticks if row["action"] == "ACT"]
    known = [row for row in acting if row["right"] is not None]
    wrong = sum(actions[index] == "ACT" and ticks[index]["right"] is False for index in begins)
    return {
        "acts": float(sum(actions[index] == "ACT" for index in begins)),
        "holds": float(sum(actions[index] == "HOLD" for index in begins)),
        "coverage": len(acting) / len(ticks) if ticks else 0.0,
        "act_only_precision": sum(row["right"] is True for row in known) / len(known) if known else float("nan"),
        "false_assists_per_min": wrong / (seconds / 60.0),
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
