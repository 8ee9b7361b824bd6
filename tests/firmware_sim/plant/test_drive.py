"""A drive follows late, no further than its limit, and gets warm."""

from __future__ import annotations

from dataclasses import replace

import pytest

from firmware_sim.plant.drive import Drive
from firmware_sim.plant.parameters import PRESETS


def _after(drive: Drive, asked_nm: float, milliseconds: int) -> float:
    for _ in range(milliseconds):
        drive.step(asked_nm, 0.001)
    return drive.torque_nm


@pytest.mark.parametrize("name", PRESETS)
def test_it_comes_to_what_was_asked_and_no_further_than_its_limit(name: str) -> None:
    assert _after(Drive(PRESETS[name]), 2.0, 1_000) == pytest.approx(2.0)
    assert _after(Drive(PRESETS[name]), 50.0, 1_000) == pytest.approx(PRESETS[name].limit_nm)


def test_a_soft_exosuit_does_nothing_for_its_dead_time() -> None:
    drive = Drive(PRESETS["soft"])
    assert _after(drive, 2.0, 200) == 0.0
    assert _after(drive, 2.0, 1) > 0.0


def test_a_hot_winding_takes_torque_back_and_never_goes_beyond_its_end() -> None:
    drive = Drive(replace(PRESETS["quasi-direct"], kelvin_per_watt=30.0, joule_per_kelvin=0.5))
    assert drive.limit_nm() == 6.0
    assert _after(drive, 6.0, 120_000) < 6.0
    assert 100.0 < drive.winding_c < 120.0
    _after(drive, 0.0, 600_000)
    assert drive.limit_nm() == 6.0
