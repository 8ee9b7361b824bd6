import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.features import hands
from hilbridge.features.hands import HandTracker
from hilbridge.limits import MS
from hilbridge.records import Hand, HandTracks


def tracks(t_ms: int, *points: tuple[float, float]) -> HandTracks:
    return HandTracks(t_ms * MS, tuple(Hand(x, y, 0.9) for x, y in points))


def test_x_and_y_are_observed_apart_and_velocity_is_learned():
    tracker = HandTracker()
    states = None
    for step in range(25):
        t_ms = 40 * step
        states = tracker.update(tracks(t_ms, (0.1 + 0.02 * step, 0.8)), t_ms * MS)
    assert states is not None
    hand = states[0]
    assert hand is not None
    assert (hand.x, hand.y) == pytest.approx((0.58, 0.8), abs=0.01)
    assert (hand.vx, hand.vy) == pytest.approx((0.5, 0.0), abs=0.05)


def test_crossing_order_of_detections_does_not_swap_tracks():
    rng = np.random.default_rng(2)
    tracker = HandTracker()
    for step in range(50):
        points = [(0.3, 0.5), (0.7, 0.5)]
        if rng.uniform() < 0.5:
            points.reverse()
        states = tracker.update(tracks(40 * step, *points), 40 * step * MS)
        assert states is not None
        left, right = states
        assert left is not None
        assert right is not None
        assert left.x == pytest.approx(0.3, abs=0.02)
        assert right.x == pytest.approx(0.7, abs=0.02)


def test_a_missed_hand_coasts_160_ms_then_it_is_gone():
    tracker = HandTracker()
    for t_ms in range(0, 400, 40):
        tracker.update(tracks(t_ms, (0.3, 0.5), (0.7, 0.5)), t_ms * MS)
    present = []
    for t_ms in range(400, 640, 40):
        states = tracker.update(tracks(t_ms, (0.3, 0.5)), t_ms * MS)
        assert states is not None
        assert states[0] is not None
        present.append(states[1] is not None)
    assert present == [True, True, True, True, False, False]


def test_a_silent_detector_makes_the_modality_invalid():
    tracker = HandTracker()
    frozen = tracks(0, (0.3, 0.5))
    assert tracker.update(None, 0) is None
    assert tracker.update(frozen, 0) is not None
    assert tracker.update(frozen, 150 * MS) is not None
    assert tracker.update(frozen, 151 * MS) is None
    assert tracker.update(tracks(200), 200 * MS) == (None, None)


def test_a_third_hand_and_hands_that_cannot_be_are_ignored():
    tracker = HandTracker()
    bad = HandTracks(0, (Hand(math.nan, 0.5, 0.9), Hand(0.2, math.inf, 0.9), Hand(0.5, 0.5, 0.1)))
    assert tracker.update(bad, 0) == (None, None)
    states = tracker.update(tracks(40, (0.2, 0.5), (0.8, 0.5), (0.5, 0.2)), 40 * MS)
    assert states is not None
    assert [state is not None for state in states] == [True, True]


def test_of_a_thousand_hands_at_once_the_eight_likeliest_are_looked_at(monkeypatch):
    widths = []

    def counted(distance):
        widths.extend(len(row) for row in distance)
        return nearest(distance)

    nearest = hands.nearest
    monkeypatch.setattr(hands, "nearest", counted)
    tracker = HandTracker()
    crowd = tuple(Hand(0.5 + 0.0004 * k, 0.5, 0.4) for k in range(1000))
    likely = (Hand(0.2, 0.6, 0.95), Hand(0.8, 0.6, 0.94))
    for step in range(3):
        states = tracker.update(HandTracks(step * 40_000_000, crowd + likely), step * 40_000_000)
    assert states is not None
    assert [round(state.x, 2) for state in states if state is not None] == [0.2, 0.8]
    assert set(widths) == {hands.MAX_CANDIDATES}


def test_one_hand_found_twice_takes_one_slot():
    tracker = HandTracker()
    for step in range(3):
        found = (Hand(0.48, 0.5, 0.7), Hand(0.51, 0.51, 0.9), Hand(0.51, 0.51, 0.9), Hand(0.2, 0.5, 0.8))
        states = tracker.update(HandTracks(40 * step * MS, found), 40 * step * MS)
        assert states is not None
        assert sorted(round(hand.x, 1) for hand in states if hand is not None) == [0.2, 0.5]
    tracker.reset()
    states = tracker.update(HandTracks(0, (Hand(0.51, 0.5, 0.9), Hand(0.51, 0.5, 0.9))), 0)
    assert states is not None
    assert sum(hand is not None for hand in states) == 1


@pytest.mark.parametrize("speed", [0.3, 0.5, 0.8, 1.5])
@pytest.mark.parametrize("above", [0.0, 0.03, 0.1])
@pytest.mark.parametrize("hidden", [False, True])
def test_hands_that_cross_keep_their_slots(speed: float, above: float, hidden: bool):
    """They pass each other in the middle, seen in any order; nearer than a palm one hides the other."""
    rng = np.random.default_rng(3)
    tracker = HandTracker()
    states = None
    steps = round(0.6 / speed / 0.04)
    for step in range(steps + 6):
        way = speed * 0.04 * min(step, steps)
        points = [(0.2 + way, 0.5 + rng.normal(0, 0.003)), (0.8 - way, 0.5 + above + rng.normal(0, 0.003))]
        if hidden and math.dist(*points) < 0.06:
            points.pop()
        rng.shuffle(points)
        states = tracker.update(tracks(40 * step, *[(float(x), float(y)) for x, y in points]), 40 * step * MS)
    assert states is not None
    left, right = states
    assert left is not None
    assert right is not None
    assert (left.x, right.x) == (pytest.approx(0.8, abs=0.03), pytest.approx(0.2, abs=0.03))


NUMBERS = st.floats(-0.2, 1.2) | st.sampled_from((math.nan, math.inf, -math.inf, 1e300))


@given(st.lists(st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), max_size=4), max_size=20))
def test_no_number_that_is_none_ever_enters_a_filter(pictures: list[list[tuple[float, float, float]]]):
    tracker = HandTracker()
    for step, found in enumerate(pictures):
        hands_seen = HandTracks(40 * step * MS, tuple(Hand(*numbers) for numbers in found))
        for state in tracker.update(hands_seen, 40 * step * MS) or ():
            assert state is None or all(map(math.isfinite, (state.x, state.y, state.vx, state.vy)))
