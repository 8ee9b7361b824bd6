"""Muscles follow their nerves late, end at their strength, and stiffen together."""

from __future__ import annotations

import pytest

from firmware_sim.plant.muscles import Muscles


def test_torque_rises_within_tens_of_milliseconds_and_falls_more_slowly() -> None:
    muscles, rising, falling = Muscles(50.0), 0, 0
    while muscles.torque_nm() < 9.0:
        muscles.excite(10.0, 0.0, 0.001)
        rising += 1
    while muscles.torque_nm() > 1.0:
        muscles.excite(0.0, 0.0, 0.001)
        falling += 1
    assert 5 < rising < 40 < falling < 250


def test_more_than_all_is_not_to_be_had() -> None:
    muscles = Muscles(50.0)
    for _ in range(1_000):
        muscles.excite(-500.0, 0.0, 0.001)
    assert muscles.torque_nm() == pytest.approx(-50.0)


def test_both_together_stiffen_and_pull_nothing() -> None:
    muscles = Muscles(50.0)
    for _ in range(1_000):
        muscles.excite(0.0, 0.05, 0.001)
    stiffness, damping = muscles.spring()
    assert muscles.torque_nm() == pytest.approx(0.0)
    assert (stiffness, damping) == pytest.approx((4.0, 0.2))
