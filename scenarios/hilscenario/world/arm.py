"""The wearer's arm as faults move it: it trembles, and it pushes against the assist. Pure."""

from __future__ import annotations

import math

from hilscenario.world.fault_board import Active, FaultBoard

PUSHING = ("wearer.opposing", "wearer.tremor")
_TREMOR_NM_PER_DEG = 0.3  # of the arm's amplitude


def opposing(board: FaultBoard, assist: float) -> Active | None:
    """The fault that pushes against the assist; None while there is no assist to push against."""
    return board.get("wearer.opposing") if assist else None


def push_nm(board: FaultBoard, assist: float, now_ns: int) -> float:
    """Torque of the wearer's arm beside the intended movement. Only the sign of `assist` counts."""
    torque_nm = 0.0
    if (against := opposing(board, assist)) is not None:
        torque_nm -= math.copysign(against["torque_nm"], assist)
    if (tremor := board.get("wearer.tremor")) is not None:
        amplitude_nm = _TREMOR_NM_PER_DEG * tremor["arm_deg"]
        torque_nm += amplitude_nm * math.sin(2.0 * math.pi * tremor["hz"] * now_ns * 1e-9)
    return torque_nm
