"""The controller on the worn arm: it follows without a latch, and the same person gives the same run."""

from __future__ import annotations

import pytest

from firmware_sim.plant.nerves import CONTROLS, Person
from firmware_sim.plant.parameters import PRESETS
from firmware_sim.plant.tremors import KINDS, Shaking
from firmware_sim.states import Reason, State
from firmware_sim.worn_device import WornDevice

Pair = tuple[float, float]


def _still(t_s: float) -> tuple[Pair, Pair, Pair]:
    del t_s
    return (0.5, 1.2), (0.0, 0.0), (0.0, 0.0)


def _device(preset: str) -> WornDevice:
    return WornDevice(Person(_still, CONTROLS["steady"], Shaking(KINDS["essential"], 1)), PRESETS[preset])


@pytest.mark.parametrize("preset", ["quasi-direct", "series-elastic"])
def test_it_follows_a_trembling_arm(preset: str) -> None:
    device = _device(preset)
    for _ in range(1_500):
        device.tick()
    assert device.state.state is State.FOLLOW
    assert device.state.torque.assist_unm == 0
    assert abs(device.arm.angle[1] - 1.2) < 0.1


def test_a_soft_exosuit_follows_too_late_for_the_tracking_watchdog() -> None:
    device = _device("soft")
    for _ in range(300):
        device.tick()
    assert (device.state.state, device.state.reason) == (State.LATCHED, Reason.TORQUE_TRACKING)


def test_the_same_person_gives_the_same_run() -> None:
    one, other = _device("quasi-direct"), _device("quasi-direct")
    for _ in range(300):
        one.tick()
        other.tick()
    assert (one.arm.angle, one.arm.device_speed) == (other.arm.angle, other.arm.device_speed)
