"""runtime.senses: what each source says reaches `health` as it is, and all of it ends together (H8, H9)."""

from __future__ import annotations

from typing import Any

import pytest

from hilbridge.config import SensorsConfig
from hilbridge.errors import InputError
from hilbridge.features.lens import GazeMap
from hilbridge.features.plane import homography_of
from hilbridge.limits import MS
from hilbridge.records import GazeSample
from hilbridge.rows import decode, encode
from hilbridge.runtime.health import first_problem
from hilbridge.runtime.senses import Senses, _refuse_to_guess, open_tracker
from hilbridge.sensors.clock import DeviceClock, Probe
from hilbridge.sensors.source import Source, SourceState


class Told(Source[Any]):
    """A source that is in the state it is told to be in; what was done with it is kept in order, in `done`."""

    def __init__(self, name: str, done: list[str]) -> None:
        super().__init__(name)
        self.done = done
        self.state, self.last_captured_ns = SourceState.RUNNING, 1000 * MS

    def start(self) -> None:
        self.done.append(f"{self.name} starts")

    def stop(self, timeout_s: float = 2.0) -> None:
        self.done.append(f"{self.name} stops")

    def _read_all(self) -> None:
        raise AssertionError("never read")


class World:
    def __init__(self, *, gaze: bool = True, find_hands: Any = None) -> None:
        self.done: list[str] = []
        self.camera = Told("camera", self.done)
        self.gaze = Told("gaze", self.done) if gaze else None
        self.senses = Senses(self.camera, self.gaze, find_hands, camera_fps=25.0, config=SensorsConfig())
        self.senses.vision.freeze.changed_ns = 990 * MS

    def problem(self, now_ms: int = 1000) -> str | None:
        return first_problem(self.senses.seen(), now_ms * MS)


@pytest.mark.parametrize("state", [state for state in SourceState if state is not SourceState.RUNNING])
@pytest.mark.parametrize("name", ["camera", "gaze"])
def test_h9_a_source_that_does_not_run_is_gone(name: str, state: SourceState) -> None:
    world = World()
    assert world.problem() is None
    getattr(world, name).state = state
    assert world.problem() == f"{name} is gone"


def test_h9_a_vision_worker_that_failed_sees_nothing() -> None:
    world = World()
    world.senses.vision.failure = ValueError("no model")
    assert world.problem() == "camera is gone"


def test_h8_each_source_is_judged_by_its_own_last_stamp() -> None:
    world = World()
    assert world.gaze is not None
    world.camera.last_captured_ns = None
    assert world.problem() == "camera has not delivered yet"
    world.camera.last_captured_ns = 1300 * MS
    world.senses.vision.freeze.changed_ns = 1300 * MS
    assert world.problem(1300) == "gaze silent for more than 120 ms"
    world.gaze.last_captured_ns = 1300 * MS
    assert world.problem(1300) is None


def test_h8_a_frozen_picture_is_seen() -> None:
    world = World()
    world.senses.vision.freeze.changed_ns = 800 * MS
    assert world.problem() == "camera shows the same picture for more than 150 ms"


def test_without_an_eye_tracker_the_camera_is_all_there_is() -> None:
    world = World(gaze=False)
    assert [sensor.name for sensor in world.senses.seen()] == ["camera"]
    assert set(world.senses.accounts()) == {"camera", "features"}
    world.senses.stop()
    assert world.done == ["camera stops"]


@pytest.mark.parametrize(("camera", "gaze", "ended"), [(0, 0, False), (1, 0, True), (0, 1, True), (1, 1, True)])
def test_it_has_ended_when_any_recording_has(camera: int, gaze: int, ended: bool) -> None:
    world = World()
    assert world.gaze is not None
    states = (SourceState.RUNNING, SourceState.ENDED)
    world.camera.state, world.gaze.state = states[camera], states[gaze]
    assert world.senses.ended is ended


def test_a_detector_that_cannot_be_made_is_told_before_a_device_is_taken() -> None:
    def none() -> Any:
        raise InputError("hand model: not there")

    world = World(find_hands=none)
    with pytest.raises(InputError, match="not there"):
        world.senses.start()
    assert world.done == []
    world.senses.stop()


def test_all_start_and_all_stop() -> None:
    world = World()
    world.senses.start()
    world.senses.stop()
    assert world.done == ["camera starts", "gaze starts", "camera stops", "gaze stops"]
    assert not world.senses.vision._thread.is_alive()


def test_every_value_of_every_cell_is_accounted_for() -> None:
    world = World()
    assert world.gaze is not None
    for _ in range(3):
        world.camera.cell.put(object())
    world.camera.cell.fail()
    world.gaze.cell.put(object())
    world.gaze.cell.take()
    world.senses.vision.frames_with_hands = 2
    accounts = world.senses.accounts()
    camera, gaze = accounts["camera"], accounts["gaze"]
    assert (camera.received, camera.used, camera.overwritten, camera.failed, camera.pending) == (4, 0, 2, 1, 1)
    assert (gaze.received, gaze.used, gaze.pending) == (1, 1, 0)
    assert world.senses.take() is None


def test_a_device_with_a_clock_of_its_own_is_recorded_with_it() -> None:
    world = World()
    assert world.senses.clocks(2000 * MS) == ()
    assert world.gaze is not None
    clock = DeviceClock()
    world.gaze.clock = clock  # type: ignore[attr-defined]
    assert world.senses.clocks(2000 * MS) == ()
    for index in range(10):
        clock.add(Probe(index * 100 * MS, index * 100 * MS + 301 * MS, index * 100 * MS + 2 * MS))
    (row,) = world.senses.clocks(902 * MS)
    assert (row.device, row.offset_ns, row.bound_ms, row.probes) == ("gaze", -300 * MS, 1.0, 10)
    assert decode(row.topic, row.time_ns, encode(row)) == row


def test_a_live_eye_tracker_is_judged_more_strictly() -> None:
    world = World()
    world.gaze.live = True  # type: ignore[union-attr]
    assert world.problem(1080) is None
    assert world.problem(1081) == "gaze silent for more than 80 ms"


def test_the_configuration_opens_a_live_eye_tracker() -> None:
    tracker = open_tracker(SensorsConfig(gaze="udp:127.0.0.1:45981", gaze_latency_ms=3.0))
    assert tracker.live
    assert tracker.name == "gaze udp:45981"
    tracker.start()
    tracker.stop()


def test_a_hand_detector_that_can_die_is_judged_like_a_sensor() -> None:
    world = World()
    vision = world.senses.vision
    vision.hands_alive, vision.hands_ns = True, None
    assert world.problem() == "hands has not delivered yet"
    vision.hands_ns = 1000 * MS
    assert world.problem() is None
    vision.hands_alive = False
    assert world.problem() == "hands is gone"


@pytest.mark.parametrize(
    ("camera", "gaze", "sure"),
    [
        ("0", "neon:", False),
        ("0", "neon:10.0.0.2", False),
        ("rtsp://[", "neon:10.0.0.2", False),
        ("rtsp://10.0.0.3:8086/?camera=world", "neon:10.0.0.2:8080", False),
        ("rtsp://10.0.0.20:8086/?camera=world", "neon:10.0.0.2:8080", False),
        ("rtsp://10.0.0.2:8086/?camera=world", "neon:10.0.0.2:8080", True),
        ("0", "lsl:Gaze", True),
        ("0", None, True),
    ],
)
def test_gaze_of_another_camera_is_not_guessed_at(camera: str, gaze: str | None, sure: bool) -> None:
    config = SensorsConfig(camera=camera, gaze=gaze)
    if sure:
        _refuse_to_guess(config)
        return
    with pytest.raises(InputError, match="gaze_same_camera"):
        _refuse_to_guess(config)
    _refuse_to_guess(config.model_copy(update={"gaze_same_camera": True}))


def test_gaze_is_carried_before_it_is_handed_on() -> None:
    told = Told("gaze", [])
    told.adjust = GazeMap(plane=homography_of([0.5, 0, 0.25, 0, 0.5, 0.25, 0, 0, 1])).sample
    told._deliver(GazeSample(5, 0.0, 1.0, True), 5)
    assert told.cell.take() == GazeSample(5, 0.25, 0.75, True)
