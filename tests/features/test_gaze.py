import math

import numpy as np
import pytest

from hilbridge.features.gaze import GazeFilter
from hilbridge.limits import MS
from hilbridge.records import GazeSample


def sample(t_ms: int, x: float, y: float, valid: bool = True) -> GazeSample:
    return GazeSample(t_ms * MS, x, y, valid)


def test_noise_of_a_fixation_is_smoothed():
    rng = np.random.default_rng(1)
    gaze = GazeFilter()
    xs, raw = [], []
    for step in range(200):
        noisy = 0.5 + rng.normal(0.0, 7.0 / 1280.0)
        raw.append(noisy)
        state = gaze.update(sample(5 * step, noisy, 0.5), 5 * step * MS)
        assert state is not None
        xs.append(state.x)
    assert np.std(xs[50:]) < 0.6 * np.std(raw[50:])


def test_a_saccade_is_followed_within_one_sample():
    gaze = GazeFilter()
    for step in range(20):
        gaze.update(sample(40 * step, 0.2, 0.2), 40 * step * MS)
    state = gaze.update(sample(800, 0.7, 0.6), 800 * MS)
    assert state is not None
    assert (state.x, state.y) == pytest.approx((0.7, 0.6), abs=1e-6)
    assert state.dx == pytest.approx(0.5 / 0.04, rel=0.01)


def test_a_blink_is_bridged_for_100_ms_and_then_gaze_is_invalid():
    gaze = GazeFilter()
    for t_ms in range(0, 200, 40):
        gaze.update(sample(t_ms, 0.4, 0.4), t_ms * MS)
    assert gaze.update(sample(200, math.nan, math.nan, valid=False), 200 * MS) is not None
    assert gaze.update(sample(240, 0.0, 0.0, valid=False), 240 * MS) is not None
    assert gaze.update(sample(280, 0.0, 0.0, valid=False), 280 * MS) is None
    state = gaze.update(sample(320, 0.9, 0.1), 320 * MS)
    assert state is not None
    assert state.x == pytest.approx(0.9)


@pytest.mark.parametrize("x", [math.nan, math.inf, -math.inf, 1e30, -7.0])
def test_impossible_numbers_never_poison_the_filter(x: float):
    gaze = GazeFilter()
    gaze.update(sample(0, 0.5, 0.5), 0)
    gaze.update(sample(40, x, 0.5), 40 * MS)
    state = gaze.update(sample(80, 0.5, 0.5), 80 * MS)
    assert state is not None
    assert state.x == pytest.approx(0.5, abs=1e-3)


def test_a_stale_sample_and_the_same_sample_again_are_not_news():
    gaze = GazeFilter()
    assert gaze.update(sample(0, 0.5, 0.5), 200 * MS) is None
    frozen = sample(300, 0.5, 0.5)
    seen = [gaze.update(frozen, t_ms * MS) is not None for t_ms in range(300, 500, 20)]
    assert seen == [True] * 6 + [False] * 4
