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
