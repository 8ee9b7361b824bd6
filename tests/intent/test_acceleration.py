"""intent.acceleration: tremor of 3 to 12 Hz is found in time and named; what is no tremor is not; lost samples do no harm."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hilbridge.intent.acceleration import AccelerationGuard, Line, strongest_line
from hilbridge.records import BodySample

START_NS = 10**12


def felt(seconds: float, rate_hz: float, seed: int, *, reach: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Stamps and acceleration of a hand that turns in gravity, and reaches if asked to (minimum jerk, one after another)."""
    random = np.random.default_rng(seed)
    times = np.arange(0.0, seconds, 1.0 / rate_hz)
    values = random.normal(0.0, 0.05, (len(times), 3))
    turn = np.sin(2 * np.pi * 0.4 * times + random.uniform(0, 6))
    values += 9.81 * np.column_stack([np.sin(turn), 0 * turn, np.cos(turn)])
    begin = random.uniform(0.0, 1.0)
    while reach and begin < seconds:
        lasts, far = random.uniform(0.6, 1.4), random.uniform(0.1, 0.4)
        part = (times - begin) / lasts
        pull = np.where((part >= 0) & (part <= 1), far / lasts**2 * (60 * part - 180 * part**2 + 120 * part**3), 0.0)
        values += pull[:, None] * random.normal(size=3) / 1.7
        begin += lasts + random.uniform(0.0, 0.5)
    return times, values


def tremor(times: np.ndarray, hz: float, rms: float, seed: int) -> np.ndarray:
    along = np.random.default_rng(seed).normal(size=3)
    wave = rms * math.sqrt(2) * np.sin(2 * np.pi * hz * times + seed)
    return wave[:, None] * along / np.linalg.norm(along)


def play(
    times: np.ndarray, values: np.ndarray, lost: float = 0.0, seed: int = 0
) -> list[tuple[float, bool, Line | None]]:
    guard, kept = AccelerationGuard(), np.random.default_rng(seed).random(len(times)) >= lost
    told = []
    for when_s, row in zip(times[kept], values[kept], strict=True):
        trembling = guard.update(BodySample(START_NS + round(when_s * 1e9), "HAND_R", *row.tolist()))
        told.append((float(when_s), trembling, guard.line))
    return told


@pytest.mark.parametrize("rate_hz", [60.0, 100.0])
@pytest.mark.parametrize("hz", [3.0, 3.5, 4.0, 5.0, 6.3, 8.0, 9.7, 11.0, 12.0])
def test_tremor_is_found_within_a_second_and_a_half_to_a_third_of_a_hertz(hz: float, rate_hz: float) -> None:
    for seed in range(3):
        times, values = felt(4.0, rate_hz, seed)
        values += np.where(times[:, None] >= 1.0, tremor(times, hz, 1.0, seed), 0.0)
        told = play(times, values, lost=0.05, seed=seed)
        found_s = next(when_s for when_s, trembling, _ in told if trembling)
        assert 1.0 < found_s <= 2.5
        at_s, line = next((when_s, line) for when_s, _, line in reversed(told) if when_s <= 2.5)
        assert line is not None
        assert abs(line.hz - hz) <= 0.3, (at_s, line)
        assert line.rms == pytest.approx(1.0, abs=0.15)


def test_tremor_while_reaching_holds_and_reaching_alone_hardly_does() -> None:
    shaking, calm = [], []
    for seed in range(5):
        times, values = felt(8.0, 60.0, seed, reach=True)
        calm += [trembling for _, trembling, _ in play(times, values)]
        told = play(times, values + tremor(times, 3.0 + 2 * seed, 0.8, seed))
        shaking += [trembling for when_s, trembling, _ in told if when_s > 1.5]
    assert np.mean(shaking) > 0.95
    assert np.mean(calm) < 0.05


def test_tremor_that_ends_is_over_within_the_window() -> None:
    times, values = felt(6.0, 100.0, 1)
    values += np.where(times[:, None] < 3.0, tremor(times, 6.0, 1.0, 1), 0.0)
    told = play(times, values)
    assert next(trembling for when_s, trembling, _ in told if when_s >= 2.9)
    assert not any(trembling for when_s, trembling, _ in told if when_s >= 4.5)


def test_another_sensor_is_not_looked_at_and_each_hand_is() -> None:
    guard = AccelerationGuard()
    times, values = felt(2.0, 100.0, 2)
    shaken = values + tremor(times, 5.0, 2.0, 2)
    for when_s, calm_row, row in zip(times, values, shaken, strict=True):
        now_ns = START_NS + round(when_s * 1e9)
        guard.update(BodySample(now_ns, "FOREARM_R", *row.tolist()))
        guard.update(BodySample(now_ns, "HAND_R", *calm_row.tolist()))
        assert not guard.trembling
    for when_s, row in zip(times, shaken, strict=True):
        guard.update(BodySample(START_NS + round((when_s + 2) * 1e9), "left hand", *row.tolist()))
    assert guard.trembling
    assert guard.line is not None
    assert guard.line.hz == pytest.approx(5.0, abs=0.1)


def test_h9_the_hand_that_fell_silent_says_until_when_hands_were_felt() -> None:
    guard = AccelerationGuard()
    assert guard.heard_ns is None
    guard.update(BodySample(START_NS, "HAND_L", 0, 0, 9.81))
    guard.update(BodySample(START_NS + 50, "HAND_R", 0, 0, 9.81))
    guard.update(BodySample(START_NS + 90, "HAND_R", 0.0, 0.0, 0.0, valid=False))
    assert guard.heard_ns == START_NS


@settings(max_examples=60)
@given(
    st.lists(st.tuples(st.integers(-(10**9), 2 * 10**9), st.floats(-1e6, 1e6), st.booleans()), min_size=1, max_size=80)
)
def test_nothing_that_comes_makes_a_number_that_is_none(samples: list[tuple[int, float, bool]]) -> None:
    guard = AccelerationGuard()
    now_ns = START_NS
    for step_ns, value, valid in samples:
        now_ns += step_ns // 40
        guard.update(BodySample(now_ns, "hand", value, -value, 0.0, valid=valid))
        line = guard.line
        assert line is None or all(map(math.isfinite, (line.hz, line.rms, line.share)))


def test_flat_values_have_no_line() -> None:
    times = np.arange(128) / 100.0
    line = strongest_line(times, np.ones((128, 3)))
    assert line is None or line.rms < 1e-9
