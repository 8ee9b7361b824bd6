"""Integer arithmetic and tables of the torque law."""

from __future__ import annotations

import itertools
import math

import pytest

from firmware_sim.law import numbers


def test_sine_table_is_a_sine() -> None:
    assert tuple(round(1000 * math.sin(math.radians(degree))) for degree in range(91)) == numbers.SINE
    for angle in range(-400_000, 400_000, 977):
        assert numbers.sine_per_mille(angle) == pytest.approx(1000 * math.sin(math.radians(angle / 1000)), abs=2)


def test_division_rounds_towards_zero_as_c_does() -> None:
    assert [numbers.div(a, b) for a, b in ((7, 2), (-7, 2), (0, 3), (-1, 3))] == [3, -3, 0, 0]


def test_clamp() -> None:
    assert [numbers.clamp(value, 5) for value in (-9, -5, 0, 5, 9)] == [-5, -5, 0, 5, 5]


@pytest.mark.parametrize(("table", "whole"), [(numbers.REMAINING, 1000), (numbers.WAY, 1_000_000)])
def test_ways_are_minimum_jerk(table: tuple[int, ...], whole: int) -> None:
    last = len(table) - 1
    for tick, left in enumerate(table):
        s = tick / last
        assert left == pytest.approx(whole * (1 - s**3 * (10 - 15 * s + 6 * s * s)), abs=1)
    assert (table[0], table[-1], len(table)) == (whole, 0, len(table))


def test_the_way_of_support_has_no_stairs() -> None:
    steps = [before - after for before, after in itertools.pairwise(numbers.WAY)]
    assert len(steps) == 500
    assert max(steps) <= 3751  # 1.875 / 500
    assert max(abs(b - a) for a, b in itertools.pairwise(steps)) <= 25


def test_a_reach_is_whole_at_its_end() -> None:
    assert (numbers.REACHED[0], numbers.REACHED[50], numbers.REACHED[100]) == (0, 500, 1000)
