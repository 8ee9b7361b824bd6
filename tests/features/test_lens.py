"""features.lens: points straightened and bent as OpenCV would, gaze carried through, numbers of no lens refused."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.config import LensSection, SensorsConfig
from hilbridge.errors import InputError
from hilbridge.features.lens import GazeMap, lens_of
from hilbridge.features.plane import homography_of
from hilbridge.records import GazeSample
from hilbridge.runtime.senses import gaze_map

# Of a scene camera of about 100 degrees, 1600 x 1200.
SIZE, MATRIX, BENDING = (1600, 1200), [892.0, 892.0, 808.0, 600.0], [-0.13, 0.11, 0.0003, -0.0005, -0.02]
INSIDE = st.floats(0.0, 1.0)


@given(INSIDE, INSIDE)
def test_points_are_straightened_as_opencv_does_and_come_back(x: float, y: float) -> None:
    lens = lens_of("gaze_lens", SIZE, MATRIX, BENDING)
    matrix = np.array([[MATRIX[0], 0, MATRIX[2]], [0, MATRIX[1], MATRIX[3]], [0, 0, 1]])
    expected = cv2.undistortPoints(np.array([[[x * 1600, y * 1200]]]), matrix, np.array(BENDING), P=matrix)[0, 0]
    assert lens.straight(x, y) == pytest.approx((expected[0] / 1600, expected[1] / 1200))
    assert lens.bent(*lens.straight(x, y)) == pytest.approx((x, y), abs=2e-3)


def test_the_middle_stays_and_the_corner_moves() -> None:
    lens = lens_of("gaze_lens", SIZE, MATRIX, BENDING)
    assert lens.straight(808 / 1600, 0.5) == pytest.approx((808 / 1600, 0.5), abs=1e-9)
    assert math.dist(lens.straight(0.02, 0.02), (0.02, 0.02)) > 0.01


def test_what_leaves_the_picture_is_invalid() -> None:
    carried = GazeMap(plane=homography_of([2, 0, -0.5, 0, 2, -0.5, 0, 0, 1]))
    assert carried.sample(GazeSample(7, 0.5, 0.5, True)) == GazeSample(7, 0.5, 0.5, True)
    assert carried.sample(GazeSample(7, 0.1, 0.5, True)) == GazeSample(7, 0.0, 0.0, False)
    assert not carried.sample(GazeSample(7, 0.5, 0.5, False)).valid
    assert not carried.sample(GazeSample(7, math.nan, 0.5, True)).valid


@given(INSIDE, INSIDE)
def test_gaze_through_both_lenses_of_one_camera_is_where_it_was(x: float, y: float) -> None:
    lens = lens_of("gaze_lens", SIZE, MATRIX, BENDING)
    found = GazeMap(lens, homography_of([1, 0, 0, 0, 1, 0, 0, 0, 1]), lens).sample(GazeSample(7, x, y, True))
    if found.valid:  # at the very edge it may fall outside
        assert (found.x, found.y) == pytest.approx((x, y), abs=2e-3)
    else:
        assert min(x, y, 1 - x, 1 - y) < 2e-3


@pytest.mark.parametrize(
    ("matrix", "bending", "said"),
    [
        (MATRIX[:3], BENDING, "3 and 5 numbers"),
        (MATRIX, BENDING[:3], "4 and 3 numbers"),
        ([math.nan, *MATRIX[1:]], BENDING, "numbers"),
        ([0.9, 0.9, 0.5, 0.5], BENDING, "is of no picture of 1600 x 1200"),
        ([892.0, 892.0, 1700.0, 600.0], BENDING, "is of no picture"),
        (MATRIX, [-0.9, 0.0, 0.0, 0.0], "folds"),
        (MATRIX, [-1e9, 0.0, 0.0, 0.0, 1e30], "folds"),
    ],
)
def test_numbers_of_no_lens_are_one_line(matrix: list[float], bending: list[float], said: str) -> None:
    with pytest.raises(InputError, match=said) as refused:
        lens_of("gaze_lens", SIZE, matrix, bending)
    assert str(refused.value).startswith("gaze_lens: ")
    assert "cv2.calibrateCamera" in str(refused.value)


def test_lenses_alone_do_not_say_where_one_picture_lies_in_the_other() -> None:
    section = LensSection(width=1600, height=1200, matrix=MATRIX, distortion=BENDING)
    assert gaze_map(SensorsConfig()) is None
    with pytest.raises(InputError, match="set gaze_homography"):
        gaze_map(SensorsConfig(gaze_lens=section))
    straightened = gaze_map(SensorsConfig(gaze_lens=section, gaze_same_camera=True))
    assert straightened is not None
    assert straightened.tracker is not None
    assert straightened.camera is straightened.plane is None
