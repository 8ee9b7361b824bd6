"""features.plane: gaze carried between pictures as OpenCV would, and numbers that are of something else refused."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.errors import InputError
from hilbridge.features.plane import homography_of

SHIFT = st.floats(-0.15, 0.15)


@given(shifts=st.lists(SHIFT, min_size=8, max_size=8), x=st.floats(0, 1), y=st.floats(0, 1))
def test_points_go_where_opencv_puts_them(shifts: list[float], x: float, y: float) -> None:
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    there = corners + np.array(shifts, np.float32).reshape(4, 2)
    matrix = cv2.getPerspectiveTransform(corners, there)
    expected = cv2.perspectiveTransform(np.array([[[x, y]]], np.float64), matrix)[0, 0]
    assert homography_of(matrix.ravel().tolist()).carry(x, y) == pytest.approx(tuple(expected), abs=1e-6)


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ([1, 0, 0, 0, 1, 0], "nine finite"),
        ([1, 0, 0, 0, math.nan, 0, 0, 0, 1], "nine finite"),
        ([0] * 9, "behind|flattens"),
        ([1, 0, 0, 0, 0, 0, 0, 0, 1], "flattens"),
        ([-1, 0, 1, 0, 1, 0, 0, 0, 1], "flips"),
        ([0.001, 0, 0, 0, 0.001, 0, 0, 0, 1], "flattens"),
        ([1, 0, 0, 0, 1, 0, -2, 0, 1], "behind"),
    ],
)
def test_numbers_that_are_no_view_of_the_picture_are_one_line(numbers: list[float], said: str) -> None:
    with pytest.raises(InputError, match=said) as refused:
        homography_of(numbers)
    assert "\n" not in str(refused.value)
    assert "; take it with" in str(refused.value)
