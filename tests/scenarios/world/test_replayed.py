"""hilscenario.world.replayed: the recording of an earlier run in the wearer's place, as beliefs, features or sensors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from hilbridge.errors import InputError
from hilbridge.observe.keeping.pictures import PictureFormat, image_row, scene_row
from hilbridge.observe.reading import read_recording
from hilbridge.observe.recording import Recording
from hilbridge.rows import FeaturesRow
from hilbridge.wearer.person import Wearer
from hilscenario.format.files import scenario_of
from hilscenario.format.schema import Session
from hilscenario.lockstep.run import run_scenario
from hilscenario.verdict.outcome import Run
from hilscenario.world.replayed import Relived

S = 1_000_000_000
BASE: dict[str, object] = {
    "name": "replayed",
    "seed": 7,
    "duration": "5 s",
    "expect": [{"that": "always device.assist_nm <= 2.001"}],
}


@pytest.fixture(scope="module")
def earlier(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("earlier") / "run.mcap"
    run_scenario(scenario_of({**BASE, "duration": "6 s"}), recording=path)
    return path


def play(path: Path, replay: str, **more: object) -> Run:
    return run_scenario(scenario_of({**BASE, "intent": {"recording": str(path), "replay": replay}, **more}))


def test_features_of_a_recording_go_through_todays_predictor(earlier: Path) -> None:
    again = play(earlier, "features")
    first = run_scenario(scenario_of({**BASE}))
    believed = [row.top_confidence for row in first.ticks]
    assert [row.top_confidence for row in again.ticks] == believed
    assert [row.action for row in again.ticks] == [row.action for row in first.ticks]
    assert any(believed)


def test_a_session_may_begin_later_and_must_be_long_enough(earlier: Path) -> None:
    late = run_scenario(
        scenario_of(
            {**BASE, "duration": "3 s", "intent": {"recording": str(earlier), "replay": "features", "from": "2 s"}}
        )
    )
    assert len(late.ticks) > 60
    with pytest.raises(InputError, match=r"run\.mcap: lasts .* s, the scenario needs 9\.00 s"):
        play(earlier, "features", duration="9 s")


def test_a_sensor_that_falls_silent_takes_its_modality_along(earlier: Path) -> None:
    run = play(earlier, "features", steps=[{"fault": "gaze.off", "at": "3 s", "for": "1 s"}])
    assert any(row.sensor_problem for row in run.ticks)
    assert run.result.faults[0].worked


def test_where_no_features_were_recorded_there_are_none(earlier: Path, tmp_path: Path) -> None:
    with Recording(tmp_path / "gap.mcap") as out:
        for row in read_recording(earlier):
            if not row.topic.startswith("/signal") and not (isinstance(row, FeaturesRow) and S < row.time_ns < 2 * S):
                out.write(row)
    run = play(tmp_path / "gap.mcap", "features")
    unseen = [row for row in run.ticks if 1.3 * S < row.time_ns < 1.9 * S]
    assert all(row.valid == (False, False, False) for row in unseen)


def with_pictures(earlier: Path, path: Path) -> Path:
    """The same recording with what a camera saw."""
    wearer = Wearer(7, width_px=320, height_px=240)
    with Recording(path) as out:
        for row in read_recording(earlier):
            if row.topic.startswith("/signal"):
                continue
            out.write(row)
            if isinstance(row, FeaturesRow):
                frame = wearer.frame(row.captured_ns)
                out.write(scene_row(frame, row.time_ns))
                out.write(image_row(frame, PictureFormat(), row.time_ns))
    return path


def test_sensors_of_a_recording_go_through_todays_chain(earlier: Path, tmp_path: Path) -> None:
    path = with_pictures(earlier, tmp_path / "seen.mcap")
    run = play(path, "sensors")
    assert run.result.passed, run.result.problems()
    assert [row.valid for row in run.ticks].count((True, True, True)) > 100
    assert any(row.top_confidence is not None for row in run.ticks)
    person = Relived(Session(recording=str(path), replay="sensors"), 5 * S)
    then = Wearer(7, width_px=320, height_px=240)
    seen = person.frame(2 * S)
    assert seen.captured_ns == 2 * S
    assert seen.rgb.shape == (80, 107, 3)
    assert person.gaze(2 * S).x == pytest.approx(then.gaze(2 * S).x, abs=0.2)
    assert replace(person.hands(2 * S), captured_ns=0).hands


def test_what_a_recording_lacks_is_one_line(earlier: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"run\.mcap: holds no pictures; replay its `beliefs`"):
        play(earlier, "sensors")
    with Recording(tmp_path / "old.mcap") as out:
        for row in read_recording(earlier, ("/meta", "/tick", "/belief")):
            out.write(row)
    with pytest.raises(InputError, match=r"old\.mcap: holds no features"):
        play(tmp_path / "old.mcap", "features")


@pytest.mark.parametrize(
    ("intent", "said"),
    [
        ({"features": "a.npz", "replay": "features"}, "`replay` says what of a `recording`"),
        ({"recording": "a.mcap", "replay": "dreams"}, "beliefs"),
    ],
)
def test_a_replay_of_nothing_is_refused(intent: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        scenario_of({**BASE, "intent": intent})


def test_recorded_features_cannot_be_spoiled() -> None:
    step = {"fault": "gaze.garbage", "at": "1 s", "for": "1 s"}
    with pytest.raises(InputError, match="changes what is seen"):
        scenario_of({**BASE, "intent": {"recording": "a.mcap", "replay": "features"}, "steps": [step]})
