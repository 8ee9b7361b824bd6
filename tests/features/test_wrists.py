"""features.wrists: a skeleton's wrists become hands of the picture, and only where the camera sees none."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.errors import InputError
from hilbridge.features.wrists import Projection, WristHands, projection_of, stood_in
from hilbridge.limits import MS, SENSING_LIMIT_NS
from hilbridge.records import BodySample, Hand, HandTracks

# A camera with its centre in the skeleton's origin: focal length of one picture width, principal point in the middle.
PLAIN = (1.0, 0.0, 0.5, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 0.0, 1.0, 0.0)
NOW_NS = 10**12


def wrist(
    x: float, y: float, z: float, *, name: str = "RIGHT_WRIST", ago_ns: int = 0, valid: bool = True
) -> BodySample:
    return BodySample(NOW_NS - ago_ns, name, x, y, z, valid)


def worn(*samples: BodySample) -> WristHands:
    made = WristHands(projection_of(PLAIN))
    for sample in samples:
        made.put(sample)
    return made


def test_a_wrist_lies_where_the_camera_would_have_it() -> None:
    found = worn(wrist(0.2, -0.1, 1.0), wrist(-0.4, 0.2, 2.0, name="LEFT_WRIST", ago_ns=20 * MS)).hands_at(NOW_NS)
    assert found is not None
    assert [(hand.x, hand.y) for hand in found.hands] == [(pytest.approx(0.3), pytest.approx(0.6)), (0.7, 0.4)]
    assert found.captured_ns == NOW_NS - 20 * MS  # the older of the two


@pytest.mark.parametrize(
    "sample",
    [
        wrist(0.2, 0.1, -1.0),  # behind the camera
        wrist(2.0, 0.1, 1.0),  # beside the picture
        wrist(0.0, 0.0, 1.0, ago_ns=SENSING_LIMIT_NS + 1),
        wrist(0.0, 0.0, 1.0, valid=False),
        wrist(0.0, 0.0, 1.0, name="RIGHT_ELBOW"),
    ],
)
def test_a_wrist_that_is_not_seen_is_no_hand(sample: BodySample) -> None:
    assert worn(sample).hands_at(NOW_NS) is None


def test_a_wrist_that_is_lost_takes_the_last_one_away() -> None:
    assert worn(wrist(0.0, 0.0, 1.0), wrist(0.0, 0.0, 1.0, valid=False)).hands_at(NOW_NS) is None


def test_hands_that_the_camera_sees_go_before() -> None:
    wrists, seen = worn(wrist(0.0, 0.0, 1.0)), HandTracks(NOW_NS, (Hand(0.1, 0.1, 0.9),))
    none = HandTracks(NOW_NS, ())
    assert stood_in(seen, wrists, NOW_NS) is seen
    assert stood_in(none, None, NOW_NS) is none
    assert stood_in(none, worn(), NOW_NS) is none
    for found in (none, None):
        hands = stood_in(found, wrists, NOW_NS)
        assert hands is not None
        assert hands.hands == (Hand(0.5, 0.5, 1.0),)


@pytest.mark.parametrize(
    "numbers", [(), PLAIN[:11], (*PLAIN[:11], math.nan), (0.0,) * 12, (*PLAIN[:4], *PLAIN[:4], *PLAIN[8:])]
)
def test_numbers_of_no_camera_are_one_line(numbers: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match=r"skeleton_projection: .*solvePnP"):
        projection_of(numbers)


@given(st.lists(st.floats(-1e9, 1e9), min_size=12, max_size=12), *[st.floats(-1e9, 1e9)] * 3)
def test_no_place_becomes_a_number_that_is_none(numbers: list[float], x: float, y: float, z: float) -> None:
    made = WristHands(Projection(tuple(numbers)))
    made.put(wrist(x, y, z))
    found = made.hands_at(NOW_NS)
    assert found is None or all(0.0 <= hand.x <= 1.0 and 0.0 <= hand.y <= 1.0 for hand in found.hands)
