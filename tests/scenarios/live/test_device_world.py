"""hilscenario.live.device_world: faults as typed commands, counted by what the device obeyed."""

from __future__ import annotations

from hilscenario.live.device_world import DeviceWorld
from hilscenario.world.fault_board import FaultBoard
from tests.scenarios.made import line, scenario

MS = 1_000_000


def injected(*steps: tuple[str, dict[str, float]]) -> tuple[FaultBoard, DeviceWorld, list[str]]:
    board = FaultBoard(scenario(steps=[{"fault": fault, "at": "1 ms", "with": more} for fault, more in steps]).steps)
    typed: list[str] = []
    return board, DeviceWorld(board, typed.append), typed


def test_a_device_fault_that_ends_leaves_the_others_and_counts_only_what_the_device_obeyed() -> None:
    lag = ("device.actuator_lag", {"time_constant_ms": 50.0})
    board, world, typed = injected(lag, ("device.torque_bias", {"bias_nm": 0.5}))
    world.change(board.inject(0, 0))
    world.change(board.inject(1, 0))
    assert typed[-4:] == ["encoder 0", "mend", "lag 50", "bias 0.5"]
    world.saw(line(0, "Assist", 0.5).row)
    assert [active.effects for active in board.all] == [0, 0]  # typed, and not obeyed yet
    for command in typed[-4:]:
        world.obeyed(command)
    world.saw(line(5, "Assist", 0.5).row)
    world.saw(line(10, "Follow", 0.0).row)  # a lag does nothing to a motor that gives no torque
    assert [active.effects for active in board.all] == [1, 2]
    typed.clear()
    world.change(board.end(0))
    assert typed == ["encoder 0", "mend", "bias 0.5"]


def test_an_overrun_counts_when_it_is_obeyed_and_is_not_typed_again_at_its_end() -> None:
    board, world, typed = injected(("device.tick_overrun", {"overrun_ms": 8.0}))
    world.change(board.inject(0, 0))
    world.change(board.end(0))
    assert typed == ["overrun 8"]
    assert board.all[0].effects == 0
    world.obeyed("overrun 8")
    assert board.all[0].effects == 1


def test_the_wearer_pushes_against_the_assist_trembles_and_lets_go() -> None:
    board, world, typed = injected(
        ("wearer.opposing", {"torque_nm": 2.0}), ("wearer.tremor", {"hz": 5.0, "arm_deg": 2.0})
    )
    board.inject(0, 0)
    assert world.push(0.4, 0)
    assert world.push(-0.4, 0)
    assert world.push(0.0, 0)  # no assist, nothing to push against
    assert typed == ["push -2.0000", "push 2.0000", "push 0.0000"]
    board.inject(1, 0)
    assert world.push(0.4, 50 * MS)
    assert typed[-1] == "push -1.4000"
    board.end(0)
    board.end(1)
    assert not world.push(0.4, 50 * MS)
    assert typed[-1] == "push 0.0000"
