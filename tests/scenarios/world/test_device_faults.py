"""hilscenario.world.device_faults: what is wrong with the device is the sum of the faults under way."""

from __future__ import annotations

from hilscenario.world.device_faults import BIAS, ENCODER, LAG, Broken, acting, broken
from hilscenario.world.fault_board import FaultBoard
from tests.scenarios.made import scenario

STEPS = [
    {"fault": ENCODER, "at": "1 ms", "with": {"offset_deg": 2.5}},
    {"fault": LAG, "at": "1 ms", "with": {"time_constant_ms": 60}},
    {"fault": BIAS, "at": "1 ms", "with": {"bias_nm": -0.5}},
]


def test_a_fault_that_ends_leaves_the_others() -> None:
    board = FaultBoard(scenario(steps=STEPS).steps)
    assert broken(board) == Broken(0, None, None)
    for number in range(3):
        board.inject(number, 0)
    assert broken(board) == Broken(2500, 60.0, -0.5)
    board.end(1)
    assert broken(board) == Broken(2500, None, -0.5)


def test_a_lag_does_nothing_to_a_motor_that_gives_no_torque() -> None:
    board = FaultBoard(scenario(steps=STEPS).steps)
    for number in range(3):
        board.inject(number, 0)
    assert [active.step.fault for active in acting(board, gives_torque=True)] == [ENCODER, LAG, BIAS]
    assert [active.step.fault for active in acting(board, gives_torque=False)] == [ENCODER, BIAS]
