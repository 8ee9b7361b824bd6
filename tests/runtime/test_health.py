"""runtime.health: what each sensor last said, against its limits (H8, H9)."""

from __future__ import annotations

import numpy as np
import pytest

from hilbridge.config import SensorsConfig
from hilbridge.limits import TICK_NS
from hilbridge.records import CameraFrame
from hilbridge.runtime.health import (
    MS,
    FreezeProbe,
    SensorSeen,
    camera_seen,
    first_problem,
    gaze_seen,
    sensor_problem,
    still_seen,
)


def seen(**changes: object) -> SensorSeen:
    values: dict[str, object] = {
        "name": "camera",
        "alive": True,
        "captured_ns": 1000 * MS,
        "changed_ns": 1000 * MS,
        "timeout_ns": 120 * MS,
        "freeze_ns": 150 * MS,
    }
    return SensorSeen(**{**values, **changes})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("sensor", "now_ms", "said"),
    [
        (seen(), 1000, None),
        (seen(), 1120, None),
        (seen(), 1121, "camera silent for more than 120 ms"),
        (seen(), 999, "camera stamps lie in the future"),
        (seen(alive=False), 1000, "camera is gone"),
        (seen(captured_ns=None), 1000, "camera has not delivered yet"),
        (seen(changed_ns=850 * MS), 1000, None),
        (seen(changed_ns=849 * MS), 1000, "camera shows the same picture for more than 150 ms"),
        (seen(changed_ns=0, freeze_ns=None), 1000, None),
        (seen(changed_ns=None), 1000, None),
    ],
)
def test_h8_h9_sensor_problems_are_named(sensor: SensorSeen, now_ms: int, said: str | None) -> None:
    assert sensor_problem(sensor, now_ms * MS) == said


def test_the_first_problem_is_the_one_named_and_no_sensor_is_a_problem() -> None:
    assert first_problem((), 0) == "no sensor is connected"
    assert first_problem((seen(), seen(name="gaze", alive=False)), 1000 * MS) == "gaze is gone"
    assert first_problem((seen(), seen(name="gaze")), 1000 * MS) is None


def test_a_source_is_judged_by_the_limits_of_the_configuration() -> None:
    limits = SensorsConfig(camera_timeout_ms=100, gaze_timeout_ms=80, freeze_ms=60)
    assert camera_seen(limits, True, 5, 3) == SensorSeen("camera", True, 5, 3, 100 * MS, 60 * MS)
    assert gaze_seen(limits, False, 7) == SensorSeen("gaze", False, 7, None, 80 * MS, None)


def picture(captured_ns: int, pixels: np.ndarray, palette: np.ndarray | None = None) -> CameraFrame:
    return CameraFrame(captured_ns, pixels, 0, palette=palette)


def test_a_picture_that_does_not_change_keeps_the_time_of_its_last_change() -> None:
    probe, pixels = FreezeProbe(), np.zeros((72, 96, 3), np.uint8)
    assert probe.changed_ns is None
    for captured_ns in (10, 20):
        probe.look(picture(captured_ns, pixels))
        assert probe.changed_ns == 10
    other = pixels.copy()
    other[16, 32] = 1
    probe.look(picture(30, other))
    assert probe.changed_ns == 30


def test_a_drawn_picture_changes_when_its_colours_do_not_when_its_numbers_do() -> None:
    probe = FreezeProbe()
    colours = np.array([[10, 20, 30], [10, 20, 30], [99, 99, 99]], np.uint8)
    probe.look(picture(10, np.zeros((72, 96), np.uint8), colours))
    probe.look(picture(20, np.ones((72, 96), np.uint8), colours))  # another number of the same colour
    assert probe.changed_ns == 10
    probe.look(picture(30, np.broadcast_to(colours[0], (72, 96, 3))))  # the same picture in full colour
    assert probe.changed_ns == 10
    probe.look(picture(40, np.ones((72, 96), np.uint8), colours[::-1]))
    assert probe.changed_ns == 10
    probe.look(picture(50, np.zeros((72, 96), np.uint8), colours[::-1]))
    assert probe.changed_ns == 50


def test_h8_a_live_eye_tracker_is_held_within_its_limit_not_at_the_tick_after() -> None:
    limits = SensorsConfig()
    live = gaze_seen(limits, True, 0, live=True)
    assert live.timeout_ns + TICK_NS <= limits.gaze_timeout_ms * MS
    assert gaze_seen(limits, True, 0).timeout_ns == limits.gaze_timeout_ms * MS
    assert gaze_seen(SensorsConfig(gaze_timeout_ms=30), True, 0, live=True).timeout_ns == 15 * MS


@pytest.mark.parametrize(
    ("gone", "seen_still"),
    [
        ({"gaze"}, (False, True, True)),
        ({"camera"}, (True, False, False)),
        ({"hands"}, (True, False, True)),
        ({"inertial"}, (True, True, True)),
        ({"camera", "gaze"}, (False, False, False)),
    ],
)
def test_a_sensor_that_fails_takes_its_own_modalities_alone(gone, seen_still):
    names = ("camera", "gaze", "hands", "inertial")
    sensors = tuple(seen(name=name, alive=name not in gone) for name in names)
    assert still_seen((True, True, True), sensors, 1000 * MS) == seen_still
    assert still_seen((True, True, True), (), 1000 * MS) == (False, False, False)
    assert not any(still_seen((False, False, False), sensors, 1000 * MS))
