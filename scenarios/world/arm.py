"""The wearer's arm as faults move it."""

from __future__ import annotations

import math

from scenarios.world.fault_board import Active


def tremor_torque_nm(tremor: Active, now_ns: int) -> float:
    """The wearer's shaking muscles: 0.3 N m per degree of the arm's amplitude at the tremor's frequency."""
    return 0.3 * tremor["arm_deg"] * math.sin(2.0 * math.pi * tremor["hz"] * now_ns * 1e-9)
