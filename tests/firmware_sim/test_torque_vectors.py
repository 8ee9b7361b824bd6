"""The torque law against its committed vectors: a change of one unit in one tick is seen."""

from __future__ import annotations

import itertools
import math

import pytest

from firmware_sim.law import numbers
from tests.firmware_sim import torque_vectors

STORIES = [list(rows) for _, rows in itertools.groupby(torque_vectors.read(), key=lambda row: row[0].story)]


@pytest.mark.parametrize("first", range(20))
def test_the_law_gives_what_its_vectors_say(first: int) -> None:
    rows = list(itertools.chain(*STORIES[first::20]))
    for (_, now), (segment, expected) in zip(torque_vectors.replayed([row[0] for row in rows]), rows, strict=True):
        assert now == expected, segment


SINES = [round(1000 * math.sin(math.radians(degree))) for degree in range(91)]


def sine(angle_mdeg: int) -> int:
    """By the symmetries of the sine, linear between whole degrees."""
    turn = angle_mdeg % 360_000
    if turn >= 180_000:
        return -sine(turn - 180_000)
    if turn > 90_000:
        return sine(180_000 - turn)
    degree, rest = divmod(turn, 1000)
    return SINES[degree] + (SINES[min(degree + 1, 90)] - SINES[degree]) * rest // 1000


def test_sine_at_every_angle_of_four_turns() -> None:
    near = (
        quarter * 90_000 + off for quarter in range(-8, 9) for off in (-1001, -1000, -999, -1, 0, 1, 999, 1000, 1001)
    )
    for angle in (*range(-720_000, 720_000, 250), *near):
        assert numbers.sine_per_mille(angle) == sine(angle), angle
