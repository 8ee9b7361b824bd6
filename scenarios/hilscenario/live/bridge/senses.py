"""The simulated wearer's sensors in real time, with every sensor fault of the vocabulary."""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

from hilbridge.config import SensorsConfig
from hilbridge.records import CameraFrame, GazeSample, HandTracks
from hilbridge.runtime.senses import Senses
from hilbridge.sensors.source import Source
from hilscenario.format.schema import Scenario
from hilscenario.world.fault_board import FaultBoard
from hilscenario.world.sensing import CAMERA_PERIOD_NS, GAZE_PERIOD_NS, Body, SensorEdge, detected, edges

T = TypeVar("T", CameraFrame, GazeSample)


class EdgeSource(Source[T]):
    """Samples the wearer once per period on the scenario's time grid; faults decide when each arrives."""

    def __init__(
        self, edge: SensorEdge[T], period_ns: int, epoch_ns: int, clock_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        super().__init__(edge.name, clock_ns)
        self._edge: SensorEdge[T] = edge
        self._period_ns, self._epoch_ns = period_ns, epoch_ns

    def _read_all(self) -> None:
        under_way: list[tuple[int, int, T]] = []  # samples of a delayed sensor that are not yet delivered
        asked = 0
        due_ns = max(0, self._clock_ns() - self._epoch_ns) // self._period_ns * self._period_ns
        while self._sleep_until(self._epoch_ns + min(due_ns, under_way[0][0] if under_way else due_ns)):
            now_ns = self._clock_ns() - self._epoch_ns
            if now_ns >= due_ns:
                if (delivered := self._edge.deliver(due_ns)) is not None:
                    asked += 1
                    heapq.heappush(under_way, (delivered[0], asked, delivered[1]))
                # A computer too slow for the sensor's rate skips samples; it never takes old ones later.
                due_ns += self._period_ns * max(1, (now_ns - due_ns) // self._period_ns)
            while under_way and under_way[0][0] <= now_ns:
                value = heapq.heappop(under_way)[2]
                captured_ns = self._epoch_ns + value.captured_ns
                self._deliver(replace(value, captured_ns=captured_ns), captured_ns)


class EdgeHands:
    """The hand detector: looks at the picture's moment, through the edge."""

    def __init__(self, edge: SensorEdge[HandTracks], body: Body, epoch_ns: int) -> None:
        self._edge, self._body, self._epoch_ns = edge, body, epoch_ns

    def detect(self, frame: CameraFrame) -> HandTracks | None:
        """What is found; None from a detector that gives nothing at all."""
        found = detected(self._edge, self._body, frame.captured_ns - self._epoch_ns)
        return None if found is None else replace(found, captured_ns=found.captured_ns + self._epoch_ns)

    def close(self) -> None:
        """Called by the vision worker, in its own thread, when it ends."""
        self._body.close()


def edge_senses(scenario: Scenario, board: FaultBoard, epoch_ns: int) -> Senses:
    """Camera, gaze and hands of the scenario's wearer, whose time 0 is `epoch_ns` of the monotonic clock."""
    # A wearer caches what it has planned and is not to be shared between threads; equal seeds are equal people.
    seen, looked, held = (Body(scenario, board) for _ in range(3))
    camera = EdgeSource(edges(seen, board, scenario.seed)[0], CAMERA_PERIOD_NS, epoch_ns)
    gaze = EdgeSource(edges(looked, board, scenario.seed)[1], GAZE_PERIOD_NS, epoch_ns)
    hands = EdgeHands(edges(held, board, scenario.seed)[2], held, epoch_ns)
    return Senses(camera, gaze, lambda: hands, camera_fps=1e9 / CAMERA_PERIOD_NS, config=SensorsConfig())
