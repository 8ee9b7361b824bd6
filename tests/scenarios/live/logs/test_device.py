"""hilscenario.live.logs.device: the device's log lines on the grid of signals."""

from __future__ import annotations

import pytest

from hilscenario.live.logs.device import assist_figures, device_columns
from tests.scenarios.made import line


def test_words_hold_and_torque_is_straight_between_lines() -> None:
    rows = [line(0, "Ready", 0.0), line(10, "Assist", 0.0), line(20, "Assist", 1.0), line(30, "RampDown", 0.0)]
    columns = device_columns(rows, 0, 41)
    assert list(columns["device.state"][[0, 9, 10, 29, 30, 40]]) == ["Ready"] * 2 + ["Assist"] * 2 + ["RampDown"] * 2
    assert columns["device.assist_nm"][[10, 15, 20, 25, 30, 40]] == pytest.approx([0.0, 0.5, 1.0, 0.5, 0.0, 0.0])
    assert list(columns["device.assist_zero"][[19, 20, 29, 30]]) == [1.0, 0.0, 0.0, 1.0]
    figures = assist_figures(columns)
    assert figures["assist_s"] == pytest.approx(0.010)
    assert figures["assist_energy_j"] == pytest.approx(sum(1.0 - k / 10 for k in range(10)) * 1e-3)


def test_ages_are_on_the_devices_own_clock_and_grow_between_lines() -> None:
    act = {"accepted_live": True, "accepted_ms": 1005}
    hold = {"accepted_live": True, "accepted_ms": 1050, "accepted_hold": True}
    rows = [
        line(0, "Ready", 0.0, t_ms=1000),
        line(10, "Assist", 0.5, t_ms=1010, **act),
        line(50, "RampDown", 0.3, t_ms=1050, **hold),
        line(60, "EStop", 0.2, t_ms=1060, **hold, stop_ms=1058),
    ]
    columns = device_columns(rows, 0, 81)
    assert list(columns["device.act_age_ms"][[0, 10, 40, 70]]) == [1e6, 5.0, 35.0, 65.0]
    assert list(columns["device.hold_age_ms"][[40, 50, 80]]) == [0.0, 0.0, 30.0]
    assert list(columns["device.stop_age_ms"][[59, 60, 80]]) == [0.0, 2.0, 22.0]


def test_energy_is_of_gravity_support_too_with_and_without_assist() -> None:
    rows = [line(0, "Ready", 0.0, gravity_nm=0.5), line(40, "Ready", 0.0, gravity_nm=0.5)]
    assert assist_figures(device_columns(rows, 0, 41))["assist_energy_j"] == pytest.approx(41 * 0.5 * 1e-3)
