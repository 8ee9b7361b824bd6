"""What an adversary who holds the key makes the assist give: a seeded sample of `tests.tools.arm.figures passivity`."""

from __future__ import annotations

import pytest

from firmware_sim.law.allowance import WORK
from tests.firmware_sim.passivity import (
    REFILL_W,
    SEQUENCES_OF_A_LIFE,
    TANK_J,
    UNIT_J,
    Attack,
    Life,
    attacks,
    exceeds,
    told,
)


def test_the_tank_is_80_mj_and_fills_in_ten_seconds() -> None:
    assert pytest.approx(0.080, abs=1e-4) == TANK_J
    assert pytest.approx(TANK_J / 10.0, rel=1e-3) == REFILL_W


def test_a_sample_of_sequences_never_gives_more_than_the_tank_has() -> None:
    made = attacks(0, 12, 500)
    assert len(made) == 12 <= SEQUENCES_OF_A_LIFE
    assert [one for one in made if exceeds(one, 500)] == []
    assert max(one.push_j for one in made) > 0.0  # it was tried


def test_an_empty_tank_gives_nothing() -> None:
    life = Life(1)
    life._device.state.torque.work = WORK
    found = life.sequence(400)
    assert found.push_j <= 400 * REFILL_W * 1e-3
    assert found.spent_j <= WORK * UNIT_J + 1e-6


def test_what_is_beyond_the_tank_is_told() -> None:
    good, bad = (
        Attack("noise", 0.05, 0.01, 0.0, 0.04, latched=False),
        Attack("noise", 0.01, 0.02, 0.0, 0.04, latched=False),
    )
    assert (exceeds(good), exceeds(bad)) == (False, True)
    assert "2 sequences" in told([good, bad])[-1]
    assert "1 beyond it" in told([good, bad])[-1]
