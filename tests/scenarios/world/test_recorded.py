"""hilscenario.world.recorded: a recorded session in the wearer's place, and one line for a file that cannot be used."""

from __future__ import annotations

from pathlib import Path

import pytest

from hilbridge.errors import InputError
from hilbridge.features.layout import GAZE, HANDS, STEP_NS
from hilbridge.features.packs import write_pack
from hilbridge.intent.predictor import Predictor
from hilbridge.observe.reading import read_recording
from hilbridge.records import FeatureVector
from hilbridge.rows import HandsRow, InertialRow, TickRow
from hilbridge.sensors.models import hand_model_path, hand_model_problem
from hilbridge.wearer.person import Wearer
from hilscenario.format.files import dump_scenario, load_scenario, scenario_of
from hilscenario.format.schema import Scenario, Session
from hilscenario.lockstep.run import run_scenario
from hilscenario.verdict.outcome import Run
from hilscenario.world.parts import bundle
from hilscenario.world.recorded import Filmed, PackAssembler, Video, Worn
from tests.scenarios.sessions import film, wearers_features


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A pack, a video with gaze, and the recording of a scripted run; six seconds each."""
    made = tmp_path_factory.mktemp("sessions")
    write_pack(made / "session.npz", *wearers_features())
    film(made)
    run_scenario(scripted(), recording=made / "run.mcap")
    return made


def scripted() -> Scenario:
    script = [{"at": "0.6 s", "verb": "Pour", "confidence": 0.97}, {"at": "2 s", "verb": "Mix", "confidence": 0.9}]
    return scenario_of({**BASE, "intent": script})


BASE: dict[str, object] = {
    "name": "recorded",
    "duration": "4 s",
    "gate": {"tau_on": 0.6, "tau_off": 0.4, "alpha": 0.6},
    "expect": [{"that": "always device.assist_nm <= 2.001"}],
}


def play(intent: dict[str, object], recording: Path | None = None, **more: object) -> Run:
    return run_scenario(scenario_of({**BASE, "intent": intent, **more}), recording=recording)


def test_a_pack_gives_the_predictor_the_very_steps_that_were_recorded(folder: Path) -> None:
    run = play({"features": str(folder / "session.npz")})
    values, valid = wearers_features()
    predictor = Predictor(bundle())
    beliefs = []
    for step in range(100):
        vector = FeatureVector(step * STEP_NS, step * STEP_NS, values[step], tuple(map(bool, valid[step])))  # type: ignore[arg-type]
        beliefs.append(predictor.step(vector, vector.captured_ns))
    had = [row.top_confidence for row in run.ticks if row.new_features]
    wanted = [None if belief is None else belief.confidence for belief in beliefs]
    assert had == wanted[: len(had)]
    assert len(had) >= 95
    assert any(confidence is not None for confidence in had)
    assert run.result.passed, run.result.problems()
    assert {row.right for row in run.ticks} == {None}  # nobody wrote down what the wearer wanted


def test_a_session_may_begin_later(folder: Path) -> None:
    late = play({"features": str(folder / "session.npz"), "from": "2 s"})
    early = play({"features": str(folder / "session.npz")})
    assert [row.top_confidence for row in late.ticks] != [row.top_confidence for row in early.ticks]


def test_a_silent_sensor_takes_its_modality_from_a_pack(folder: Path) -> None:
    off = {"fault": "hands.off", "at": "1 s", "for": "1 s"}
    run = play({"features": str(folder / "session.npz")}, steps=[off])
    assert run.result.faults[0].worked
    session = Session(features=str(folder / "session.npz"))
    assembler, wearer = PackAssembler(session, 4_000_000_000), Wearer(3, width_px=96, height_px=72)
    without = assembler.update(wearer.frame(STEP_NS), None, None, STEP_NS)
    assert without.valid[:2] == (False, False)
    assert not without.values[GAZE].any()
    assert not without.values[HANDS].any()
    assert without.values.any()


def test_an_earlier_run_is_believed_again(folder: Path) -> None:
    again = play({"recording": str(folder / "run.mcap")})
    first = run_scenario(scripted())
    assert [row.action for row in again.ticks] == [row.action for row in first.ticks]
    assert [row.verb for row in again.ticks] == [row.verb for row in first.ticks]
    assert {"Pour", "Mix"} <= {row.verb for row in again.ticks}


def test_a_film_goes_through_the_projects_own_chain(folder: Path, tmp_path: Path) -> None:
    filmed: dict[str, object] = {"video": str(folder / "session.avi"), "gaze": str(folder / "gaze.csv")}
    run = play(filmed, tmp_path / "run.mcap", steps=[{"fault": "gaze.off", "at": "3 s", "for": "500 ms"}])
    assert run.result.faults[0].worked
    ticks = [row for row in read_recording(tmp_path / "run.mcap") if isinstance(row, TickRow)]
    seen = [row.valid for row in ticks[10:70]]
    assert seen.count((True, False, True)) >= 50  # gaze and scene, no hands: none were looked for
    assert any(row.top_confidence is not None for row in ticks)
    assert not any(row.sensor_problem for row in ticks[10:70])
    assert any(row.sensor_problem for row in ticks[75:])  # off from the third second on: the bridge says so


@pytest.mark.data
def test_a_real_film_with_hands_repeats_to_the_byte(data: Path, tmp_path: Path) -> None:
    problem = hand_model_problem(hand_model_path())
    if problem is not None:
        pytest.skip(f"hand model: {problem}")
    film_of: dict[str, object] = {
        "video": str(data / "hands" / "clip_720p.mp4"),
        "gaze": str(data / "neon" / "demo_recording"),
        "hands": True,
    }
    for number in range(2):
        run = play(film_of, tmp_path / f"{number}.mcap", duration="1 s")
    assert [row.valid for row in run.ticks].count((True, True, True)) >= 15
    assert (tmp_path / "0.mcap").read_bytes() == (tmp_path / "1.mcap").read_bytes()


@pytest.mark.parametrize("kind", ["pack", "film", "run"])
def test_the_same_session_gives_the_same_bytes(folder: Path, tmp_path: Path, kind: str) -> None:
    intent: dict[str, dict[str, object]] = {
        "pack": {"features": str(folder / "session.npz")},
        "film": {"video": str(folder / "session.avi"), "gaze": str(folder / "gaze.csv")},
        "run": {"recording": str(folder / "run.mcap")},
    }
    for number in range(2):
        play(intent[kind], tmp_path / f"{number}.mcap", duration="3 s")
    assert (tmp_path / "0.mcap").read_bytes() == (tmp_path / "1.mcap").read_bytes()


def test_a_video_is_the_same_read_forwards_and_after_going_back(folder: Path) -> None:
    video = Video(folder / "session.avi")
    first = video.at(500_000_000)
    late = video.at(3_000_000_000)
    again = video.at(500_000_000)
    assert first[0] == again[0] == 12
    assert (first[1] == again[1]).all()
    assert (first[1] != late[1]).any()


def test_files_are_looked_for_beside_the_scenario(folder: Path, tmp_path: Path) -> None:
    scenario = scenario_of({**BASE, "intent": {"features": "session.npz"}})
    (folder / "beside.yaml").write_text(dump_scenario(scenario))
    loaded = load_scenario(folder / "beside.yaml")
    assert isinstance(loaded.intent, Session)
    assert loaded.intent.features == str(folder / "session.npz")
    (tmp_path / "elsewhere.yaml").write_text(dump_scenario(loaded))
    assert load_scenario(tmp_path / "elsewhere.yaml") == loaded


def cut(path: Path, to: Path, share: float = 0.5) -> str:
    data = path.read_bytes()
    to.write_bytes(data[: round(len(data) * share)])
    return str(to)


def test_missing_short_and_truncated_files_are_one_line(folder: Path, tmp_path: Path) -> None:
    pack, run, video = (str(folder / name) for name in ("session.npz", "run.mcap", "session.avi"))
    gaze = str(folder / "gaze.csv")
    (tmp_path / "no.avi").write_text("no video")
    wrong: list[tuple[dict[str, object], str]] = [
        ({"features": str(tmp_path / "none.npz")}, "none.npz: not a feature pack"),
        ({"features": cut(folder / "session.npz", tmp_path / "cut.npz")}, "cut.npz: not a whole feature pack"),
        ({"features": pack, "from": "3 s"}, "session.npz: lasts 6.00 s, the scenario needs 7.00 s of it"),
        ({"recording": str(tmp_path / "none.mcap")}, "none.mcap: no such file"),
        ({"recording": cut(folder / "run.mcap", tmp_path / "cut.mcap")}, "cut.mcap: lasts"),
        ({"recording": run, "from": "1 s"}, "run.mcap: lasts"),
        ({"video": str(tmp_path / "none.avi"), "gaze": gaze}, "none.avi: no such file"),
        ({"video": str(tmp_path / "no.avi"), "gaze": gaze}, "no.avi: not a whole video"),
        ({"video": video, "gaze": str(tmp_path / "none.csv")}, "none.csv: no such file"),
        ({"video": video, "gaze": gaze, "from": "3 s"}, "session.avi: lasts 6.00 s, the scenario needs 7.00 s"),
    ]
    for intent, said in wrong:
        with pytest.raises(InputError) as refused:
            play(intent)
        assert said in str(refused.value)
        assert "\n" not in str(refused.value)


def test_a_video_cut_off_within_is_one_line(folder: Path, tmp_path: Path) -> None:
    short = cut(folder / "session.avi", tmp_path / "cut.avi", 0.6)
    session = Session(video=short, gaze=str(folder / "gaze.csv"))

    def watch() -> None:
        filmed = Filmed(session, 5_500_000_000)
        for step in range(137):
            filmed.frame(step * STEP_NS)

    with pytest.raises(InputError, match=r"cut\.avi: .*(cannot be read; it is truncated|lasts)"):
        watch()


@pytest.mark.parametrize(
    ("old", "new", "line", "said"),
    [
        ("features: a.npz", "featurs: a.npz", 3, "unknown key `intent.featurs`; did you mean `features`?"),
        ("features: a.npz", "features: a.npz, recording: b.mcap", 3, "this has features and recording"),
        ("features: a.npz", "video: a.mp4", 3, "`video` and `gaze` go together"),
        ("features: a.npz", "features: a.npz, hands: true", 3, "`hands` are looked for in a `video`"),
        ("gaze.off", "gaze.garbage", 5, "`gaze.garbage` changes what is seen, which features recorded already"),
        ("features: a.npz", "features: a.npz, from: 3", 3, "3 is no time"),
    ],
)
def test_refusals_name_file_and_line(tmp_path: Path, old: str, new: str, line: int, said: str) -> None:
    text = """\
name: recorded
duration: 4 s
intent: {features: a.npz}
steps:
  - {fault: gaze.off, at: 1 s, for: 1 s}
expect: [{figure: trips, at_most: 1}]
"""
    path = tmp_path / "bad.yaml"
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError) as refused:
        load_scenario(path)
    assert str(refused.value).startswith(f"{path}:{line}: ")
    assert said in str(refused.value)


PLAIN = [1.0, 0.0, 0.5, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 0.0, 1.0, 0.0]


def test_a_folder_of_the_iassistadl_group_is_a_wearer(tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    from tests.sensors.recorded.test_iassistadl import make

    make(tmp_path / "one", tremor_hz=11.0, gaze_off_s=0.3, lose=20)
    recording = tmp_path / "run.mcap"
    run = play(
        {"folder": str(tmp_path / "one"), "projection": PLAIN, "from": "3 s"},
        recording,
        steps=[{"fault": "gaze.off", "at": "3 s", "for": "0.5 s"}],
    )
    assert run.result.passed, run.result.problems()
    calm = [row for row in run.ticks if 0.5e9 < row.time_ns < 2.0e9]
    shaken = [row for row in run.ticks if row.time_ns > 3.5e9]
    assert {(row.gaze_valid, row.hands_valid, row.scene_valid) for row in calm} == {(True, True, False)}
    assert {row.felt_tremor for row in calm} == {False}
    assert {row.felt_tremor for row in shaken} == {True}  # 11 Hz, from 2 s of the scenario on
    rows = list(read_recording(recording, ("/hands", "/inertial", "/gaze")))
    hands = [row for row in rows if isinstance(row, HandsRow)]
    assert {(row.count, row.hands[0].x, row.hands[0].y) for row in hands} == {(1, 0.6, 0.7)}
    assert sum(isinstance(row, InertialRow) for row in rows) > 700
    again = play({"folder": str(tmp_path / "one"), "projection": PLAIN, "from": "3 s"}, tmp_path / "again.mcap")
    assert [row.confidence for row in again.ticks[:70]] == [row.confidence for row in run.ticks[:70]]


def test_a_folder_without_projection_has_no_hands_and_one_too_short_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    from tests.sensors.recorded.test_iassistadl import make

    make(tmp_path / "one", old=True)
    run = play({"folder": str(tmp_path / "one")})
    assert {row.hands_valid for row in run.ticks} == {False}
    assert run.result.passed, run.result.problems()
    with pytest.raises(InputError, match="gaze: lasts 9"):
        Worn(Session(folder=str(tmp_path / "one"), from_="8 s"), 4_000_000_000)
    with pytest.raises(InputError, match="`projection` is of the skeleton"):
        scenario_of({**BASE, "intent": {"features": "a.npz", "projection": PLAIN}})
    with pytest.raises(InputError, match=r"camera\.stuck"):
        scenario_of(
            {**BASE, "intent": {"folder": "one"}, "steps": [{"fault": "camera.stuck", "at": "1 s", "for": "1 s"}]}
        )
