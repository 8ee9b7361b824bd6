import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("sklearn")

from hilbridge.errors import InputError
from hilbridge.features.layout import PATCH, D
from hilbridge.features.packs import read_pack, write_pack
from hilbridge.learning.data import aggregates
from hilbridge.learning.data.describe import describe
from hilbridge.learning.data.egtea import DatasetError, load_actions, normalise_verb, subjects
from hilbridge.learning.data.sessions import (
    folds,
    gaze_steps,
    load_features,
    recorded_sessions,
    session_features,
    session_stream,
)
from hilbridge.sensors.begaze import BegazeError, parse_begaze, read_begaze
from hilbridge.verbs import OTHER, VERBS
from hilbridge.wearer import timeline

ROW = "{n}; clip; P0{s}-R01-Soup; {start}; {end}; {verb} it; {verb}; it\n"
OLD = "Time\tType\tTrial\tL POR X [px]\tL POR Y [px]\tFrame\tAux1\tL Event Info"
NEW = "Time\tType\tTrial\tL Pupil Diameter [mm]\tB POR X [px]\tB POR Y [px]\tL POR X [px]\tFrame\tAux1\tB Event Info"
HEADER = ["## [BeGaze]", "## Version:\tBeGaze 3.1.77", "## Sample Rate:\t30", "## Calibration Area:\t1280\t960"]


@pytest.fixture
def egtea(data: Path) -> Path:
    return data / "egtea"


def package(tmp_path: Path, lines: str) -> Path:
    folder = tmp_path / "action_annotation" / "raw_annotations"
    folder.mkdir(parents=True)
    (folder / "action_labels.csv").write_text("# header\n" + lines)
    return tmp_path


@pytest.mark.data
def test_the_real_package_is_counted(egtea):
    summary = describe(egtea)
    assert (summary.annotations, summary.sessions, summary.subjects, summary.verbs) == (15_484, 86, 32, 22)
    assert len(summary.gaze) == 10
    assert sum(file.bad_lines for file in summary.gaze) == 0
    assert {file.version[:3] for file in summary.gaze} == {"3.1", "3.4"}
    assert summary.splits == {
        "test_split1": 2022,
        "test_split2": 2022,
        "test_split3": 2021,
        "train_split1": 8299,
        "train_split2": 8299,
        "train_split3": 8300,
    }
    assert all(file.annotated and file.windows.kept >= 0.9 * file.windows.onsets for file in summary.gaze)
    assert json.loads(json.dumps(summary.as_json()))["subjects"] == 32
    assert sum(summary.by_class.values()) == 15_484
    assert list(summary.by_class)[:3] == ["Take", "Put", "Open"]


@pytest.mark.data
def test_the_wearers_statistics_are_the_real_annotations_aggregates(egtea):
    made = aggregates.aggregate(load_actions(egtea))
    stored = json.loads((Path(timeline.__file__).parent / "statistics.json").read_text())
    assert made == stored


@pytest.mark.data
@pytest.mark.slow
def test_history_on_the_real_annotations_beats_the_sensors_top5(egtea):
    from hilbridge.learning.experiments.annotated_history import evaluate_history

    result = evaluate_history(egtea, count=8)
    assert result.windows == 15_484
    assert result.top1 >= 0.30
    assert result.top5 >= 0.77
    assert result.ece15 <= 0.045


@pytest.mark.data
def test_real_folds_are_subject_disjoint_and_test_everybody_once(egtea):
    everybody = subjects(load_actions(egtea))
    made = folds(everybody, 8)
    assert sorted(name for fold in made for name in fold["test"]) == everybody
    for fold in [*made, *folds(everybody, 3)]:
        assert [len(fold[part]) for part in ("train", "validation", "test")] == [24, 4, 4]
        assert not fold["train"] & fold["test"]
        assert not fold["validation"] & (fold["test"] | fold["train"])


def test_verbs_are_normalised():
    assert normalise_verb(" take ") == VERBS.index("Take")
    assert normalise_verb("inspect/READ") == VERBS.index("Inspect/Read")
    assert normalise_verb("Crack") == normalise_verb("Juggle") == OTHER


def test_a_missing_a_broken_and_an_empty_package_name_the_file(tmp_path):
    with pytest.raises(DatasetError, match="no such file"):
        load_actions(tmp_path)
    root = package(tmp_path / "a", ROW.format(n=1, s=1, start=0, end=9, verb="Cut") + "2; too; short\n")
    with pytest.raises(DatasetError, match="line 3"):
        load_actions(root)
    with pytest.raises(DatasetError, match="holds no annotation"):
        load_actions(package(tmp_path / "b", ""))


def test_too_few_subjects_for_the_folds_are_refused():
    with pytest.raises(ValueError, match="too few"):
        folds(["a", "b", "c"], 3)


def test_old_and_new_begaze_give_the_same_gaze():
    old = parse_begaze([*HEADER, OLD, "100\tSMP\t1\t640.0\t480.0\t24\t\tFixation\r"])
    new = parse_begaze([*HEADER, NEW, "100\tSMP\t1\t0.0\t640.0\t480.0\t1.0\t00:00:01:00\t\t-"])
    for recording in (old, new):
        assert (recording.x[0], recording.y[0], recording.frame[0]) == (0.5, 0.5, 24)
        assert recording.video_s()[0] == 1.0
        assert recording.area_px == (1280, 960)
        assert recording.valid.all()


def test_blinks_lost_eyes_messages_and_bad_lines_are_told_apart():
    recording = parse_begaze(
        [
            *HEADER,
            OLD,
            "1\tSMP\t1\t640\t480\t1\t\tFixation",
            "2\tSMP\t1\t640\t480\t2\t\tBlink",
            "3\tSMP\t1\t0.00\t0.00\t3\t\t-",
            "4\tSMP\t1\tNaN\tNaN\t4\t\t-",
            "5\tMSG\t1\t# Message: start",
            "6\tSMP\t1\t640",
            "7\tSMP\t1\t640\t480\t00:00:01:99\t\t-",
            "x\tSMP\t1\t640\t480\t8\t\t-",
            "",
        ]
    )
    assert recording.valid.tolist() == [True, False, False, False]
    assert (recording.messages, recording.bad_lines) == (1, 3)
    assert np.isfinite(recording.x).all()


@pytest.mark.parametrize(
    ("lines", "word"),
    [
        ([], "no table"),
        (["## Calibration Area:\tx"], "no table"),
        ([*HEADER[:3], OLD], "calibration area"),
        (["## Calibration Area:\t0\t960", OLD], "calibration area"),
        ([*HEADER, "Time\tType\tTrial"], "column"),
        ([*HEADER, OLD], "no sample"),
        ([*HEADER, OLD, "rubbish"], "no sample"),
    ],
)
def test_what_is_no_export_is_refused_with_the_file_and_a_cure(tmp_path, lines, word):
    path = tmp_path / "gaze.txt"
    path.write_text("\n".join(lines))
    with pytest.raises(BegazeError, match=word) as caught:
        read_begaze(path)
    assert str(path) in str(caught.value)
    assert "export the session again" in str(caught.value)


def test_an_absent_export_is_refused(tmp_path):
    with pytest.raises(BegazeError, match="cannot be read"):
        read_begaze(tmp_path / "absent.txt")


def session(tmp_path: Path):
    lines = "".join(
        ROW.format(n=n, s=1, start=start, end=start + 900, verb="Cut") for n, start in enumerate((1000, 5000, 60_000))
    )
    return load_actions(package(tmp_path, lines))


def recording(seconds: int):
    rows = [f"{n}\tSMP\t1\t{640 + n % 7}\t480\t{n * 24 // 30}\t\t-" for n in range(seconds * 30)]
    return parse_begaze([*HEADER, OLD, *rows])


def test_windows_end_half_a_second_before_onset_and_discards_are_counted(tmp_path):
    values, valid = session_features(25 * 10, recording(10))
    stream, ends, counts = session_stream(3, session(tmp_path), values, valid)
    assert ends.tolist() == [125 - 13]
    assert (counts.onsets, counts.kept, counts.too_early, counts.after_the_recording) == (3, 1, 1, 1)
    assert stream.label[ends].tolist() == [VERBS.index("Cut")]
    valid[:] = False
    assert session_stream(3, session(tmp_path / "again"), values, valid)[2].too_few_valid == 1


def test_gaze_is_aligned_on_video_frames_never_from_the_future():
    steps = gaze_steps(recording(4), 100)
    assert all(sample.captured_ns <= step * 40_000_000 for step, sample in enumerate(steps))
    assert all(step * 40_000_000 - sample.captured_ns <= 42_000_000 for step, sample in enumerate(steps))


def video_at(path: Path, fps: float, frames: int) -> Path:
    import cv2

    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), fps, (96, 72))
    for number in range(frames):
        writer.write(np.full((72, 96, 3), (number * 255 // frames, 40, 200), dtype=np.uint8))
    writer.release()
    return path


@pytest.mark.parametrize("fps", [24.0, 23.976, 30.0, 60.0])
def test_a_video_is_read_in_its_own_time_and_one_of_24_frames_a_second_in_begazes(tmp_path, fps):
    (tmp_path / "videos").mkdir()
    video_at(tmp_path / "videos" / "P1.avi", fps, round(4 * fps))
    values, valid = load_features(tmp_path, "P1")
    assert len(values) == pytest.approx(100, abs=1)
    # The picture keeps changing to the last second: frames are spread over the whole of it.
    assert not np.array_equal(values[97, PATCH], values[80, PATCH])
    assert valid[:, 2].all()


def test_what_an_interruption_leaves_behind_is_no_session(tmp_path, monkeypatch):
    def interrupted(file, **_):
        file.write(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez_compressed", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_pack(tmp_path / "feature_packs" / "P1.npz", np.zeros((3, D), np.float32), np.ones((3, 3), bool))
    assert recorded_sessions(tmp_path) == []


def test_a_video_goes_through_the_same_chain_and_packs_keep_it(tmp_path):
    video = video_at(tmp_path / "v.avi", 24.0, 48)
    values, valid = session_features(50, recording(2), video)
    assert valid[5:45, [0, 2]].all()
    assert not valid[:, 1].any()
    assert values[20, PATCH].any()
    write_pack(tmp_path / "p.npz", values, valid)
    again = read_pack(tmp_path / "p.npz")
    assert (again[0] == values).all()
    assert (again[1] == valid).all()
    with pytest.raises(DatasetError, match="cannot be opened"):
        session_features(5, None, tmp_path / "absent.avi")


def test_sessions_are_packed_once_and_described_with_their_discards(tmp_path):
    from hilbridge.learning.data.packs import make_packs, missing

    root = package(
        tmp_path,
        "".join(
            ROW.format(n=n, s=1, start=start, end=start + 900, verb="Cut")
            for n, start in enumerate((1000, 5000, 60_000))
        ),
    )
    (root / "gaze_data").mkdir()
    rows = [f"{n}\tSMP\t1\t{640 + n % 7}\t480\t{n * 24 // 30}\t\t-" for n in range(300)]
    (root / "gaze_data" / "P01-R01-Soup.txt").write_text("\n".join([*HEADER, OLD, *rows]))
    fresh = load_features(root, "P01-R01-Soup")
    assert missing(root) == 1
    assert [path.name for path in make_packs(root)] == ["P01-R01-Soup.npz"]
    assert missing(root) == 0
    assert make_packs(root) == []
    assert all((one == other).all() for one, other in zip(load_features(root, "P01-R01-Soup"), fresh, strict=True))
    summary = describe(root)
    assert summary.packs == 1
    assert summary.pack_windows["P01-R01-Soup"].kept == 1
    assert "1 of 3 windows kept (discarded: 1 too early, 1 after the recording)" in "\n".join(summary.lines())
    with pytest.raises(DatasetError, match="no such folder"):
        make_packs(tmp_path / "absent")
    with pytest.raises(DatasetError, match="no pack, gaze or video"):
        load_features(root, "P02-R01-Soup")


@pytest.mark.parametrize(
    "arrays",
    [
        {"values": np.zeros((3, 4)), "valid": np.zeros((3, 3))},
        {"values": np.full((3, D), np.nan), "valid": np.zeros((3, 3))},
        {"x": np.zeros(1)},
    ],
)
def test_what_is_no_feature_pack_is_refused(tmp_path, arrays):
    path = tmp_path / "bad.npz"
    np.savez(path, **arrays)
    with pytest.raises(InputError, match="extract it again"):
        read_pack(path)
    path.write_bytes(b"no zip")
    with pytest.raises(InputError, match="extract it again"):
        read_pack(path)


@pytest.mark.data
@pytest.mark.slow
def test_believed_history_beats_gaze_alone_on_real_sessions(data):
    pytest.importorskip("torch")
    from hilbridge.learning.experiments.gaze_history import evaluate_gaze_with_history

    result = evaluate_gaze_with_history(data / "egtea")
    assert result.gaze_nll != result.marginal_nll
    assert result.windows > 900
    assert result.history_nll < result.gaze_nll
    assert result.history_recipe_nll < result.history_nll
