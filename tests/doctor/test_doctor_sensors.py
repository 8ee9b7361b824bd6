"""doctor says "well" only of what works, and names figure and cure of what does not."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import hilbridge.sensors.camera  # noqa: F401  OpenCV asks once, at its first video, how loud FFmpeg may be
from hilbridge.doctor_sensors import (
    Verdict,
    check_body,
    check_camera,
    check_gaze,
    judge_body,
    judge_camera,
    judge_tracker,
)
from hilbridge.limits import MS
from hilbridge.records import GazeSample
from hilbridge.sensors.clock import Probe
from hilbridge.sensors.live.udp import UdpGaze
from hilbridge.sensors.source import SourceState


def gaze_csv(path: Path, unit: float = 1.0, rows: int = 400, valid_every: int = 1, junk_every: int = 0) -> Path:
    lines = ["\ufefftime_s,x,y,valid"]
    for n in range(rows):
        lines.append(f"{n / 200 * unit},0.5,0.5,{int(n % valid_every == 0)}")
        lines += ["junk,1,1,1"] * (junk_every if n % 5 == 0 else 0)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"unit": 1e3}, "another unit"),  # milliseconds as seconds
        ({"unit": 1e9}, "another unit"),  # nanoseconds as seconds
        ({"unit": 1e-3}, "another unit"),
        ({"junk_every": 20}, "bad rows (80%"),
        ({"valid_every": 14}, "7% valid"),
        ({"rows": 1}, "1 sample"),
    ],
)
def test_gaze_that_would_not_work_is_ill(given: dict[str, float], says: str, tmp_path: Path) -> None:
    found = check_gaze(str(gaze_csv(tmp_path / "gaze.csv", **given)))  # type: ignore[arg-type]
    assert found.verdict is Verdict.ILL
    assert says in f"{found.text} {found.cure}"
    assert found.cure


def test_sound_gaze_is_well_and_often_lost_gaze_a_note(tmp_path: Path) -> None:
    assert check_gaze(str(gaze_csv(tmp_path / "a.csv"))).verdict is Verdict.WELL
    path = tmp_path / "b.csv"
    path.write_text("time_s,x,y,valid\n" + "".join(f"{n / 200},0.5,0.5,{int(n % 10 < 7)}\n" for n in range(200)))
    assert check_gaze(str(path)).verdict is Verdict.NOTE
    path.write_text("time_s,x,y\n" + "".join(f"{-n / 200},0.5,0.5\n" for n in range(200)))
    assert check_gaze(str(path)).verdict is Verdict.ILL  # all but one go back in time
    path.write_text("")
    assert check_gaze(str(path)).verdict is Verdict.ILL


def test_a_camera_is_judged_by_what_it_says_and_what_comes(tmp_path: Path) -> None:
    assert judge_camera("c", 30.0, 44, 1.5, ended=False).verdict is Verdict.WELL
    assert judge_camera("c", 30.0, 5, 1.5, ended=False).verdict is Verdict.ILL
    assert judge_camera("c", 30.0, 5, 0.2, ended=True).verdict is Verdict.WELL
    path = tmp_path / "slow.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 1.0, (64, 48))
    for _ in range(3):
        writer.write(np.zeros((48, 64, 3), np.uint8))
    writer.release()
    found = check_camera(str(path))
    assert found.verdict is Verdict.ILL
    assert "1 fps" in found.text


def tracker(offset_ns: int = 10**18, rtt_ms: int = 2, state: SourceState = SourceState.RUNNING) -> UdpGaze:
    source = UdpGaze(0)
    source.stop()
    source.state, source.detail = state, "the glasses are not worn"
    assert source.clock is not None
    for index in range(20):
        sent_ns = index * 100 * MS
        source.clock.add(Probe(sent_ns, sent_ns + offset_ns, sent_ns + rtt_ms * MS))
    return source


def samples(count: int, *, valid: bool = True) -> list[GazeSample]:
    return [GazeSample(index, 0.5, 0.5, valid) for index in range(count)]


def test_a_live_eye_tracker_is_judged_by_what_comes_and_its_clock() -> None:
    well = judge_tracker(tracker(), samples(300), 1.5)
    assert well.verdict is Verdict.WELL
    assert "200 a second" in well.text
    assert "clock known to 1.0 ms" in well.text
    for found, said in (
        (judge_tracker(tracker(rtt_ms=40), samples(300), 1.5), "10 ms are needed"),
        (judge_tracker(tracker(), samples(1), 1.5), "not worn"),
        (judge_tracker(tracker(state=SourceState.GONE), samples(300), 1.5), "not worn"),
        (judge_tracker(tracker(), samples(15), 1.5), "20 a second are needed"),
        (judge_tracker(tracker(), samples(300, valid=False), 1.5), "50% must be valid"),
    ):
        assert found.verdict is Verdict.ILL
        assert said in found.text
        assert found.cure


def test_doctor_listens_to_what_comes_over_udp() -> None:
    silent = check_gaze("udp:127.0.0.1:45982")
    assert silent.verdict is Verdict.ILL
    assert "nothing comes" in silent.text
    assert check_gaze("udp:x").verdict is Verdict.ILL


def test_sensors_on_the_body_are_judged_by_their_names_and_rates(tmp_path: Path) -> None:
    assert check_body("inertial", None).verdict is Verdict.NOTE
    assert judge_body("inertial", "lsl:x", {"HAND_R": 100.0, "FOREARM": 3.0}, "").verdict is Verdict.WELL
    assert "`hand`" in judge_body("inertial", "lsl:x", {"FOREARM": 100.0}, "").cure
    assert judge_body("inertial", "lsl:x", {"HAND_R": 20.0}, "").verdict is Verdict.ILL
    assert judge_body("skeleton", "lsl:x", {"LEFT_WRIST": 25.0}, "").verdict is Verdict.WELL
    assert judge_body("skeleton", "lsl:x", {}, "").verdict is Verdict.ILL
    assert check_body("skeleton", str(tmp_path / "none")).verdict is Verdict.ILL


def test_doctor_reads_the_body_of_a_folder(tmp_path: Path) -> None:
    pytest.importorskip("h5py")
    from tests.sensors.recorded.test_iassistadl import make

    folder = str(make(tmp_path / "one", lose=7))
    finding = check_body("inertial", folder)
    assert finding.verdict is Verdict.WELL
    assert "HAND_R 99.3 Hz" in finding.text
    assert "lost: FOREARM_R 7, HAND_R 7" in finding.text
    assert "RIGHT_WRIST" in check_body("skeleton", folder).text
