"""Help and harm of made-up runs, whose figures are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hilscenario.benefit.gates import Order
from hilscenario.benefit.measured import PEAKS, RADIUS_M, SUMS, added, measure, wanted
from hilscenario.benefit.played import NO_ACT, WRONG, Played
from hilscenario.benefit.visits import Visit

PLAN = wanted(Visit(0, 0, 12.0))
PLAN = replace(PLAN, carrying=PLAN.acting)
COUNT = len(PLAN.pitch)
PERFECT = Played(PLAN.hand, PLAN.pitch, np.zeros(COUNT), np.zeros(COUNT, np.int8), latched=False)


def test_a_plan_has_actions_and_what_its_hand_needs_is_its_second_derivative() -> None:
    assert 0 < PLAN.acting.sum() < COUNT
    smooth = np.diff(PLAN.hand, 2, axis=0) * 1e6 - PLAN.acceleration[1:-1]
    # Where a reach is overtaken by the next one, the plan's speed jumps.
    assert np.median(np.abs(smooth)) < 1e-3
    assert np.quantile(np.abs(smooth), 0.99) < 0.1


def test_who_is_where_the_plan_is_is_helped_in_full_and_harmed_by_nothing() -> None:
    sums = measure(PERFECT, PERFECT, [Order(0, None, None)], PLAN)
    assert set(sums) == {*SUMS, *PEAKS}
    assert sums["on_target_s"] == sums["acting_s"] == pytest.approx(PLAN.acting.sum() * 1e-3)
    assert sums["error_m2s"] == sums["tilted_rad2s"] == sums["wrong_j"] == sums["most_moved_m"] == 0.0


@pytest.mark.parametrize(("off_m", "share"), [(0.9 * RADIUS_M, 1.0), (1.1 * RADIUS_M, 0.0)])
def test_on_target_is_within_the_radius(off_m: float, share: float) -> None:
    beside = replace(PERFECT, hand=PLAN.hand + np.array([off_m, 0.0]), pitch=PLAN.pitch + 0.1)
    sums = measure(beside, beside, [], PLAN)
    assert sums["on_target_s"] == pytest.approx(share * sums["acting_s"])
    assert sums["error_m2s"] == pytest.approx(off_m**2 * sums["acting_s"])
    assert sums["tilted_rad2s"] == pytest.approx(0.01 * sums["carrying_s"])


def test_harm_is_of_acts_that_were_wrong_alone() -> None:
    effect, power = np.zeros(COUNT, np.int8), np.full(COUNT, 0.5)
    effect[1_000:1_100], effect[2_000:2_300] = WRONG, WRONG
    power[2_100:2_300] = -1.0  # what is taken back pays for nothing
    acted = replace(PERFECT, effect=effect, power=power)
    twin = replace(PERFECT, hand=PLAN.hand + np.array([0.0, 0.003]))
    asked = [Order(0, 3, False), Order(40, 3, False), Order(80, 3, True), Order(120, None, None)]
    sums = measure(acted, twin, asked, PLAN)
    assert sums["wrong_s"] == pytest.approx(0.4)
    assert sums["wrong_j"] == pytest.approx(0.1)
    assert sums["most_j"] == pytest.approx(0.05)
    assert sums["most_moved_m"] == pytest.approx(0.003)
    assert (sums["false_assists"], sums["act_ticks"], sums["right_ticks"]) == (1, 3, 1)
    assert measure(replace(acted, effect=np.full(COUNT, NO_ACT, np.int8)), twin, [], PLAN)["wrong_j"] == 0.0


def test_sessions_add_up_and_the_worst_stays_the_worst() -> None:
    one = dict.fromkeys((*SUMS, *PEAKS), 1.0)
    both = added([one, dict.fromkeys(one, 3.0)])
    assert {both[name] for name in SUMS} == {4.0}
    assert {both[name] for name in PEAKS} == {3.0}


def test_tremor_is_what_shakes_from_3_to_12_hz() -> None:
    seconds = np.arange(COUNT) * 1e-3
    for hertz, share in ((1.0, 0.0), (5.0, 1.0), (20.0, 0.0)):
        swing = np.stack([0.002 * np.sin(2.0 * np.pi * hertz * seconds), np.zeros(COUNT)], axis=1)
        plan = replace(PLAN, acting=np.ones(COUNT, bool))
        shaking = replace(PERFECT, hand=PLAN.hand + swing)
        sums = measure(shaking, shaking, [], plan)
        assert sums["tremor_m2s"] == pytest.approx(share * sums["error_m2s"], abs=1e-3 * sums["error_m2s"])
