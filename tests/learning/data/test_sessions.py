from pathlib import Path

import numpy as np
import pytest

from hilbridge.features.layout import PATCH
from hilbridge.features.packs import read_pack, write_pack
from hilbridge.learning.data.egtea import DatasetError, load_actions, subjects
from hilbridge.learning.data.sessions import (
    folds,
    gaze_steps,
    load_features,
    session_features,
    session_stream,
)
from hilbridge.verbs import VERBS
from tests.learning.package import ROW, package
from tests.sensors.begaze_lines import recording

pytest.importorskip("sklearn")


@pytest.mark.data
def test_real_folds_are_subject_disjoint_and_test_everybody_once(egtea):
    everybody = subjects(load_actions(egtea))
    made = folds(everybody, 8)
    assert sorted(name for fold in made for name in fold["test"]) == everybody
    for fold in [*made, *folds(everybody, 3)]:
        assert [len(fold[part]) for part in ("train", "validation", "test")] == [24, 4, 4]
        assert not fold["train"] & fold["test"]
        assert not fold["validation"] & (fold["test"] | fold["train"])


def session(tmp_path: Path):
    lines = "".join(
        ROW.format(n=n, s=1, start=start, end=start + 900, verb="Cut") for n, start in enumerate((1000, 5000, 60_000))
    )
    return load_actions(package(tmp_path, lines))


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
