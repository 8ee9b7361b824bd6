import numpy as np
import pytest

from hilbridge.sensors.begaze import BegazeError, parse_begaze, read_begaze
from tests.sensors.begaze_lines import HEADER, OLD

NEW = "Time\tType\tTrial\tL Pupil Diameter [mm]\tB POR X [px]\tB POR Y [px]\tL POR X [px]\tFrame\tAux1\tB Event Info"


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


def rows(fps: float, seconds: int = 4, unit_us: float = 1.0) -> list[str]:
    return [
        f"{n / 30 * 1e6 / unit_us:.3f}\tSMP\t1\t640\t480\t{int(n / 30 * fps + 1e-9)}\t\t-" for n in range(30 * seconds)
    ]


@pytest.mark.parametrize("fps", [24, 25, 30])
def test_the_frame_rate_is_that_of_the_frames(fps):
    recording = parse_begaze([*HEADER, OLD, *rows(fps)])
    assert recording.frames_per_s == fps
    late_s = recording.played_ns() / 1e9 - recording.video_s()
    assert (late_s >= -1e-8).all()  # whole nanoseconds
    assert (late_s < 1 / fps).all()
    assert (np.diff(recording.played_ns()) > 0).all()


def test_the_frame_rate_of_the_header_wins_and_25_frames_a_second_are_read_from_the_time_code():
    assert parse_begaze([*HEADER, "## Video Frame Rate:\t25", OLD, *rows(24)]).frames_per_s == 25
    codes = [f"{n * 40_000}\tSMP\t1\t640\t480\t00:00:0{n // 25}:{n % 25:02}\t\t-" for n in range(50)]
    recording = parse_begaze([*HEADER, OLD, *codes])
    assert recording.frames_per_s == 25
    assert recording.frame.tolist() == list(range(50))


def test_right_eye_only_no_frames_decimal_commas_and_milliseconds():
    names = "RecordingTime [ms]\tR POR X [px]\tR POR Y [px]"
    recording = parse_begaze(
        [*HEADER[:3], "## Calibration Area:\t1280,0\t960,0", names, "10,5\t640,0\t480,0", "43,8\t1\t1"]
    )
    assert recording.time_us.tolist() == [10_500, 43_800]
    assert (recording.x[0], recording.y[0]) == (0.5, 0.5)
    assert recording.origin_ns() is None
    assert recording.played_ns().tolist() == [10_500_000, 43_800_000]


def test_a_byte_order_mark_is_read_over(tmp_path):
    path = tmp_path / "x.txt"
    path.write_text("\ufeff" + "\n".join([*HEADER, OLD, *rows(24)]) + "\n", encoding="utf-8")
    assert read_begaze(path).area_px == (1280, 960)


def test_a_time_column_in_milliseconds_is_told_by_the_sample_rate():
    assert parse_begaze([*HEADER, OLD, *rows(24, unit_us=1000.0)]).time_us[30] == 1_000_000
