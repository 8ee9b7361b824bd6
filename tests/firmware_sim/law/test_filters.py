"""Filters of the torque law: what is voluntary, what swings, what the wearer wants."""

from __future__ import annotations

import itertools
import math

import pytest

from firmware_sim.law.filters import track
from firmware_sim.law.memory import NEVER_TICKS, Torque


def shaken(hertz: float, size: int, ticks: int, law: Torque | None = None, user_unm: int = 0) -> Torque:
    law = law or Torque()
    for time_ms in range(ticks):
        swing = math.sin(2 * math.pi * hertz * time_ms / 1000)
        track(law, round(size * swing), round(user_unm * swing))
    return law


def test_the_slow_mean_is_the_voluntary_velocity() -> None:
    law = Torque()
    for _ in range(1500):
        track(law, 30_000, 0)
    assert law.slow_mean >> 10 == pytest.approx(30_000, abs=100)
    assert law.fast_mdeg_s == pytest.approx(0, abs=100)


@pytest.mark.parametrize(("hertz", "half_ms"), [(3.0, 167), (6.0, 83), (12.0, 42)])
def test_half_waves_are_as_long_and_as_high_as_the_tremor(hertz: float, half_ms: int) -> None:
    law = shaken(hertz, 20_000, 3000)
    assert law.last_ticks == pytest.approx(half_ms, abs=2)
    assert law.before_ticks == pytest.approx(half_ms, abs=2)
    assert 16_000 < law.last_peak <= 20_000
    assert 16_000 < law.before_peak <= 20_000


def test_the_gain_keeps_a_tremors_damping_within_the_rate_of_torque() -> None:
    for hertz in (3.0, 6.0, 12.0):
        law = shaken(hertz, 60_000, 3000)
        steepest = law.gain_most * math.radians(60) * 2 * math.pi * hertz  # mN m/s
        assert 9_000 < steepest <= 15_800


def test_a_still_arm_comes_to_rest_exactly() -> None:
    law = shaken(6.0, 50_000, 1003)
    for _ in range(3000):
        track(law, 0, 0)
    assert law.fast_mdeg_s in (0, 1)
    assert law.wave_ticks == NEVER_TICKS
    assert (law.slow_mean >> 10, law.user_mean >> 10) == (0, 0)
    assert abs(law.impulse) < 1 << 9


def test_a_tremor_of_2_newton_metres_is_no_opposition() -> None:
    law = Torque()
    for time_ms in range(4000):
        track(law, 0, round(2e6 * math.sin(2 * math.pi * 3.0 * time_ms / 1000)))
        assert abs(law.user_mean >> 10) < 500_000 or time_ms < 500
    for _ in range(1000):
        track(law, 0, 2_000_000)
    assert law.user_mean >> 10 > 1_900_000


def test_the_impulse_of_damping_adds_up_and_fades() -> None:
    law = Torque(damping_unm=1_000)
    for _ in range(4):
        track(law, 0, 0)
    assert law.impulse == pytest.approx(4_000, abs=20)
    law.damping_unm, law.impulse = 0, -1_000_000
    for _ in range(512):
        track(law, 0, 0)
    assert law.impulse == pytest.approx(-1_000_000 / math.e, rel=0.01)


def test_the_window_keeps_assist_every_tenth_tick_for_a_quarter_of_a_second() -> None:
    law = Torque()
    for number in range(1, 261):
        law.assist_unm = -number
        track(law, 0, 0)
    assert list(law.peaks) == list(range(20, 261, 10))
    assert all(b - a == 10 for a, b in itertools.pairwise(law.peaks))
