"""hilscenario.live.bridge.senses: sources on a given clock deliver on the scenario's grid, faults included."""

from __future__ import annotations

from typing import Any

from hilbridge.records import CameraFrame, GazeSample
from hilscenario.live.bridge.senses import EdgeSource
from hilscenario.world.fault_board import FaultBoard
from hilscenario.world.sensing import CAMERA_PERIOD_NS, GAZE_PERIOD_NS, Body, edges
from tests.scenarios.made import scenario

MS = 1_000_000


class Watched:
    """Runs a source on a clock of its own until `end_ns`; keeps what it delivers and when."""

    def __init__(self, source: EdgeSource[Any], clock: list[int], end_ns: int) -> None:
        self.got: list[tuple[int, Any]] = []

        def sleep_until(due_ns: int) -> bool:
            clock[0] = max(clock[0], due_ns)
            return clock[0] < end_ns

        source._sleep_until = sleep_until  # type: ignore[method-assign]
        source._deliver = lambda value, captured_ns: self.got.append((clock[0], value))  # type: ignore[method-assign]
        source._read_all()


def gaze_source(*steps: tuple[str, dict[str, float]], begin_ns: int = 0) -> tuple[EdgeSource[GazeSample], list[int]]:
    clock = [begin_ns]
    made = scenario(steps=[{"fault": fault, "at": "1 ms", "with": options} for fault, options in steps])
    board = FaultBoard(made.steps)
    for number in range(len(steps)):
        board.inject(number, 0)
    edge = edges(Body(made, board), board, 1)[1]
    return EdgeSource(edge, GAZE_PERIOD_NS, 1000 * MS, lambda: clock[0]), clock


def test_a_source_delivers_on_the_scenarios_grid_with_the_monotonic_clocks_stamps() -> None:
    source, clock = gaze_source()
    got = Watched(source, clock, 1200 * MS).got
    assert [when for when, _ in got] == [(1000 + 20 * k) * MS for k in range(10)]
    assert [sample.captured_ns for _, sample in got] == [when for when, _ in got]


def test_a_sensor_that_lags_delivers_true_stamps_late_and_loses_nothing() -> None:
    source, clock = gaze_source(("gaze.delayed", {"delay_ms": 50}))
    got = Watched(source, clock, 1200 * MS).got
    assert {when - sample.captured_ns for when, sample in got} == {50 * MS}
    assert [sample.captured_ns for _, sample in got] == [(1000 + 20 * k) * MS for k in range(8)]


def test_a_sensor_that_is_off_delivers_nothing_and_one_with_a_wrong_clock_stamps_with_it() -> None:
    source, clock = gaze_source(("gaze.off", {}))
    assert Watched(source, clock, 1200 * MS).got == []
    source, clock = gaze_source(("gaze.clock_skew", {"skew_ms": 200}))
    assert {sample.captured_ns - when for when, sample in Watched(source, clock, 1200 * MS).got} == {200 * MS}


def test_a_bridge_that_is_started_again_finds_the_wearer_where_time_has_gone() -> None:
    source, clock = gaze_source(begin_ns=5007 * MS)
    first, sample = Watched(source, clock, 5100 * MS).got[0]
    assert first == 5007 * MS
    assert sample.captured_ns == 5000 * MS
    made = scenario()
    body = Body(made, FaultBoard(()))
    assert (sample.x, sample.y) == (body.gaze(4000 * MS).x, body.gaze(4000 * MS).y)


def test_pictures_have_their_own_pace() -> None:
    made = scenario()
    board = FaultBoard(())
    clock = [0]
    camera: EdgeSource[CameraFrame] = EdgeSource(
        edges(Body(made, board), board, 1)[0], CAMERA_PERIOD_NS, 0, lambda: clock[0]
    )
    got = Watched(camera, clock, 200 * MS).got
    assert [when for when, _ in got] == [0, 40 * MS, 80 * MS, 120 * MS, 160 * MS]
