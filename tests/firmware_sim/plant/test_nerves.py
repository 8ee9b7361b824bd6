"""A person on the worn arm comes near the plan; whoever misjudges, is weak or late comes less near."""

from __future__ import annotations

from math import degrees

import pytest

from firmware_sim.plant.nerves import CONTROLS, Control, Person
from firmware_sim.plant.worn import WornArm

Pair = tuple[float, float]


def _plan(t_s: float) -> tuple[Pair, Pair, Pair]:
    s = min(max(t_s - 0.5, 0.0), 1.0)
    moved, rate = s**3 * (10.0 + s * (6.0 * s - 15.0)), 30.0 * s * s * (1.0 + s * (s - 2.0))
    rises = 60.0 * s * (1.0 + s * (2.0 * s - 3.0))
    return (0.2 + 0.5 * moved, 0.8 + 0.6 * moved), (0.5 * rate, 0.6 * rate), (0.5 * rises, 0.6 * rises)


def _furthest_deg(control: Control) -> float:
    arm, person, worst = WornArm(None), Person(_plan, control), 0.0
    arm.angle = _plan(0.0)[0]
    for now_ms in range(3_000):
        t_s = (now_ms + 1) * 0.001
        arm.step((0.0, 0.0), person.step(arm, t_s))
        worst = max(worst, abs(arm.angle[1] - _plan(t_s)[0][1]))
    return degrees(worst)


@pytest.mark.parametrize("name", CONTROLS)
def test_the_free_arm_goes_where_it_is_wanted(name: str) -> None:
    assert _furthest_deg(CONTROLS[name]) < 6.0


def test_misjudged_inertia_takes_the_arm_off_its_way() -> None:
    assert _furthest_deg(Control(inertia_share=1.6)) > 1.2 * _furthest_deg(Control())
