"""hilscenario.world.arm: the wearer's arm trembles and pushes against the assist."""

from __future__ import annotations

import math

import pytest

from hilscenario.world.arm import opposing, push_nm
from hilscenario.world.fault_board import FaultBoard
from tests.scenarios.made import scenario

STEPS = [
    {"fault": "wearer.opposing", "at": "1 ms", "with": {"torque_nm": 2.0}},
    {"fault": "wearer.tremor", "at": "1 ms", "with": {"hz": 5.0, "arm_deg": 2.0}},
]


@pytest.fixture
def board() -> FaultBoard:
    return FaultBoard(scenario(steps=STEPS).steps)


@pytest.mark.parametrize(("assist", "pushes"), [(0.4, -2.0), (400_000, -2.0), (-0.1, 2.0), (0.0, 0.0), (0, 0.0)])
def test_the_wearer_pushes_against_the_assist_and_not_against_nothing(
    board: FaultBoard, assist: float, pushes: float
) -> None:
    assert push_nm(board, assist, 0) == 0.0
    active = board.inject(0, 0)
    assert push_nm(board, assist, 0) == pushes
    assert opposing(board, assist) is (active if assist else None)


def test_tremor_is_a_sine_and_adds_to_the_push(board: FaultBoard) -> None:
    board.inject(1, 0)
    quarter_ns = 50_000_000
    assert push_nm(board, 0.0, quarter_ns) == pytest.approx(0.6)
    assert push_nm(board, 0.0, 3 * quarter_ns) == pytest.approx(-0.6)
    assert math.isclose(push_nm(board, 0.0, 0), 0.0)
    board.inject(0, 0)
    assert push_nm(board, 1.0, quarter_ns) == pytest.approx(-1.4)
