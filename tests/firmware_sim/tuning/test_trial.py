"""Trials of one wearer on the worn arm: FOLLOW beside itself is no difference, today's profile keeps its bars."""

from __future__ import annotations

from math import pi, sin

import pytest

from firmware_sim.assist_profile import Guidance
from firmware_sim.plant.recorded import strongest
from firmware_sim.profiles import profile
from firmware_sim.tuning import trial
from firmware_sim.tuning.trial import FollowLatched, Trials, Wearer, held, reaching

POUR = profile(10)
SHAKING = tuple(0.6 * sin(2 * pi * 5.0 * ms * 0.001) for ms in range(3_000))
NOTHING = POUR._replace(damping=0, damping_near=0, gravity_per_mille=0, guidance=Guidance.NEVER)


def test_a_profile_that_does_nothing_leaves_all_as_in_follow() -> None:
    found = Trials(Wearer("steady", None, (SHAKING,))).figures(NOTHING)
    assert found == (1.0, 0.0, 0.0, 0.0, False)
    assert found.holds


def test_damping_takes_tremor_away_and_a_false_act_stays_below_the_bar() -> None:
    trials = Trials(Wearer("steady", None, (SHAKING,)))
    found = trials.figures(POUR)
    assert found.left < 0.9
    assert 0.0 < found.distorted_deg < trial.DISTORTED_LIMIT_DEG
    assert 0.0 < found.hand_mm < 30.0
    assert 0.0 < found.work_j < 0.1
    assert found.holds
    assert len(trials._following) == 3
    assert trials.figures(POUR) == found  # nothing is random, and FOLLOW is run once
    assert len(trials._following) == 3


def test_a_wearer_without_tremor_is_damped_for_nothing() -> None:
    found = Trials(Wearer("steady", None, ((0.0,) * 10,))).figures(NOTHING)
    assert found.left == pytest.approx(1.0)


def test_a_tremor_that_latches_the_device_by_itself_says_nothing_about_profiles() -> None:
    with pytest.raises(FollowLatched, match="before it assists"):
        Trials(Wearer("steady", None, (tuple(40.0 * one for one in SHAKING),))).figures(POUR)


def test_the_plans_are_smooth_and_begin_and_end_at_rest() -> None:
    assert held(0.0) == held(9.0)
    for t_s in (0.0, 0.99, 2.2, 2.59, 3.6, 9.0):
        assert reaching(t_s)[1] == pytest.approx((0.0, 0.0), abs=0.02)
    assert reaching(0.0)[0] == reaching(9.0)[0]
    assert reaching(2.2)[0] == pytest.approx(held(0.0)[0])
    for tick in range(1, 400):
        t_s = tick * 0.01 + 0.003
        before, after = reaching(t_s - 1e-5), reaching(t_s + 1e-5)
        for order in (0, 1):
            slope = [(b - a) / 2e-5 for a, b in zip(before[order], after[order], strict=True)]
            assert slope == pytest.approx(reaching(t_s)[order + 1], abs=2e-3)


def test_the_strongest_part_of_a_recording() -> None:
    torque = (*(0.1,) * 500, *(1.0,) * 100, *(0.1,) * 500)
    assert strongest(torque, 100) == (1.0,) * 100
    assert strongest(torque, 5_000) == torque
    assert len(strongest(torque, 300)) == 300
