"""Gravity support: a small share of the arm's weight that never goes abruptly (H3)."""

from __future__ import annotations

import itertools
from copy import copy

import pytest

from firmware_sim import torque
from firmware_sim.law.memory import Torque
from firmware_sim.law.support import support, support_gone, support_less
from firmware_sim.profiles import profile
from tests.safety.hand import POUR, TAKE, Hand

requirement = pytest.mark.requirement
CUT = profile(4)
HELD = Torque(gravity_unm=80_000, gravity_from_unm=80_000, gravity_tick=0, gravity_top_unm=80_000)


@requirement("T5")
def test_h3_gravity_support_fades_over_500_ms_on_one_smooth_curve() -> None:
    law, path = copy(HELD), [80_000]
    for _ in range(500):
        support_less(law)
        path.append(law.gravity_unm)
    assert path[-1] == 0
    assert path[250] == pytest.approx(40_000, abs=100)
    assert path[450] > 0
    steps = [a - b for a, b in itertools.pairwise(path)]
    assert all(step >= 0 for step in steps)
    assert max(steps) <= 301
    assert max(abs(b - a) for a, b in itertools.pairwise(steps)) <= 4  # uN m: no stairs, no buzz
    assert law == Torque(gravity_tick=500, gravity_from_unm=80_000)
    faded = copy(law)
    support_less(law)
    assert law == faded


@requirement("T5", "S10")
def test_h3_support_can_go_at_once() -> None:
    law = copy(HELD)
    support_gone(law)
    assert law == Torque()


def test_support_rises_over_the_ramp_to_its_share_of_the_weight() -> None:
    law = Torque()
    for number in range(1, 401):
        support(law, profile(POUR), 90_000, 1000)
        assert law.gravity_unm == number * 200
    for _ in range(5):
        support(law, profile(POUR), 90_000, 1000)
    assert (law.gravity_unm, law.gravity_from_unm, law.gravity_tick, law.gravity_top_unm) == (80_000, 80_000, 0, 80_000)


def test_support_follows_angle_and_scale() -> None:
    law = copy(HELD)
    for _ in range(500):
        support(law, profile(POUR), 30_000, 1000)
    assert law.gravity_unm == 40_000
    for _ in range(500):
        support(law, profile(POUR), 30_000, 250)
    assert law.gravity_unm == 10_000
    support(law, profile(POUR), 30_000, 1000)
    assert law.gravity_unm == 10_200
    for _ in range(500):
        support(law, profile(POUR), -30_000, 1000)
    assert law.gravity_unm == 0


@requirement("T5")
def test_h3_a_verb_without_support_takes_it_away_no_faster_than_its_500_ms() -> None:
    law, path = copy(HELD), [80_000]
    while law.gravity_unm and len(path) < 1000:
        support(law, CUT, 60_000, 1000)
        path.append(law.gravity_unm)
    assert 490 <= len(path) - 1 <= 500
    assert max(a - b for a, b in itertools.pairwise(path)) <= 161


@requirement("T5", "S4")
@pytest.mark.parametrize("verb", [TAKE, 4, 15])
def test_h3_a_change_of_verb_keeps_support_on_its_way(verb: int) -> None:
    hand = Hand().to_assist(POUR, periods=14)
    level = hand.outputs.gravity_unm
    assert level == 40_000
    path = [level]
    for period in range(14):
        hand.tick(*(hand.act(verb) if period else (hand.hold(),)), hand.heartbeat())
        path.append(hand.outputs.gravity_unm)
        for _ in range(39):
            hand.tick()
            path.append(hand.outputs.gravity_unm)
    assert hand.state.verb == verb
    assert max(a - b for a, b in itertools.pairwise(path)) <= 151  # the steepest of the 500 ms way of 40 mN m
    lost = next(number for number, left in enumerate(path) if left <= 0.1 * level) if verb == 4 else 400
    assert lost >= 370


def test_letting_go_and_assisting_again_do_not_make_support_jump() -> None:
    law = copy(HELD)
    for _ in range(200):
        torque.letting_go(law, 0)
    before = law.gravity_unm
    support(law, profile(POUR), 90_000, 1000)
    assert law.gravity_unm == before + 200
    assert (law.gravity_from_unm, law.gravity_tick) == (law.gravity_unm, 0)
