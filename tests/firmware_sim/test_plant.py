"""The physical world behind the controller: arm, motor, wearers; and what the device finds out about them."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from firmware_sim.device import Device
from firmware_sim.memory import ControllerState
from firmware_sim.plant.actuator import LIMIT_NM, Actuator
from firmware_sim.plant.arm import STOP_HIGH, STOP_LOW, WEARERS, Arm, wanted_path, wearer_torque
from firmware_sim.plant.wearers import BEHAVIOURS, EVENT_S, WEAK_NM_RAD
from firmware_sim.states import State

requirement = pytest.mark.requirement


@pytest.mark.parametrize("wearer", WEARERS)
def test_the_arm_stays_where_an_arm_can_be(wearer: str) -> None:
    device = Device(ControllerState(b"k" * 16, 1), wearer)
    for _ in range(9000):
        device.tick((), 0)
        assert STOP_LOW - 0.1 < device.arm.angle < STOP_HIGH + 0.1
    assert device.state.state == State.FOLLOW


def test_the_arm_hangs_and_its_stops_hold() -> None:
    arm = Arm(math.radians(60), 0.0)
    for _ in range(5000):
        arm.step(0.0, 0.0, 0.001)
    assert arm.angle == pytest.approx(0.0, abs=0.05)
    for _ in range(3000):
        arm.step(0.0, 8.0, 0.001)
    assert arm.angle == pytest.approx(STOP_HIGH, abs=0.15)


def test_a_reach_goes_out_and_back() -> None:
    assert wanted_path("reach", 0.0)[0] == pytest.approx(math.radians(40))
    assert wanted_path("reach", 1.5) == (pytest.approx(math.radians(95)), 0.0)
    assert wanted_path("reach", 2.5)[1] < 0
    assert wanted_path("still", 3.0) == (math.radians(45.0), 0.0)
    assert wearer_torque("tremor", Arm(), 0.0416) > wearer_torque("reach", Arm(), 0.0416) + 0.8


def test_h4_actuator_lags_saturates_and_breaks_as_told() -> None:
    motor = Actuator()
    for _ in range(10):
        motor.step(2.0, 0.001)
    assert motor.torque_nm == pytest.approx(2.0, rel=0.02)
    for _ in range(30):
        motor.step(99.0, 0.001)
    assert motor.torque_nm == pytest.approx(LIMIT_NM)
    for _ in range(30):
        motor.step(-99.0, 0.001)
    assert motor.torque_nm == pytest.approx(-LIMIT_NM)
    stuck = Actuator(1.0, stuck=True)
    stuck.step(-1.0, 0.001)
    assert stuck == Actuator(1.0, stuck=True)
    weak = Actuator(gain=0.5)
    weak.step(2.0, 1.0)
    assert weak.torque_nm < 1.01


@requirement("W8")
@pytest.mark.parametrize("fault", ["stuck", "gain", "encoder"])
def test_h4_the_device_finds_a_broken_motor_or_encoder(fault: str) -> None:
    device = Device(ControllerState(b"k" * 16, 1), "sway")
    for _ in range(200):
        device.tick((), 0)
    if fault == "stuck":
        device.break_motor(stuck=True)
    elif fault == "gain":
        device.break_motor(gain=-1.0)
    else:
        device.encoder_offset_mdeg = 4000
    for _ in range(3000):
        device.tick((), 0)
    record = device.record()
    if fault == "encoder":
        assert record["state"] == "Passive"
        assert record["follow_nm"] == 0
    elif fault == "gain":
        assert (record["state"], record["reason"]) == ("Latched", "TorqueTracking")
    else:
        assert record["state"] in ("Follow", "Latched")  # stuck near what follow mode asks is within the limit


@requirement("W6")
def test_an_injected_overrun_is_found() -> None:
    device = Device(ControllerState(b"k" * 16, 1))
    for _ in range(100):
        device.tick((), 0)
    device.skip(5)
    device.tick((), 0)
    assert device.record()["reason"] == "TickOverrun"


@pytest.mark.parametrize("stiffness", [6.0, WEAK_NM_RAD])
@pytest.mark.parametrize("name", BEHAVIOURS)
def test_every_wearer_is_one_that_a_device_in_follow_mode_bears(name: str, stiffness: float) -> None:
    wearer = replace(BEHAVIOURS[name], stiffness=stiffness)
    device = Device(ControllerState(b"k" * 16, 1), wearer)
    device.arm.angle = wearer.path(0.0)[0]
    for _ in range(7000):
        device.tick((), 0)
        if name != "lets go":  # a limp arm falls into its stop, beyond the range of motion
            assert device.state.state in (State.BOOT, State.SELFTEST, State.FOLLOW)
        assert device.state.sensor_doubt == 0
        assert STOP_LOW - 0.2 < device.arm.angle < STOP_HIGH + 0.2


def test_there_are_21_behaviours() -> None:
    assert len(BEHAVIOURS) == 21


def _kinked(name: str, t_s: float) -> bool:
    """Where a path stops dead or sets off with a jerk, its speed has two values."""
    return name == "braked reach" or abs(t_s - round(t_s, 0)) < 0.001


@pytest.mark.parametrize("name", BEHAVIOURS)
def test_the_speed_of_a_path_is_its_slope(name: str) -> None:
    path = BEHAVIOURS[name].path
    for step in range(7000):
        t_s = step * 0.001 + 0.0005
        slope = (path(t_s + 1e-5)[0] - path(t_s - 1e-5)[0]) / 2e-5
        assert path(t_s)[1] == pytest.approx(slope, abs=1e-3) or _kinked(name, t_s)


def test_wearers_pull_let_go_and_shake() -> None:
    arm = Arm(math.radians(70), 0.0)
    late, early = EVENT_S + 0.1, EVENT_S - 0.1
    limp, pulls, load = (BEHAVIOURS[name] for name in ("lets go", "pulls down", "drops a load"))
    assert (limp(arm, late), limp(arm, early)) == (0.0, pytest.approx(1.7 * math.sin(arm.angle)))
    assert pulls(arm, late) == pytest.approx(pulls(arm, early) - 1.5)
    assert load(arm, late) == pytest.approx(load(arm, early) + 1.5)
    weak = replace(BEHAVIOURS["still"], stiffness=WEAK_NM_RAD)
    assert weak(arm, 0.0) == pytest.approx(1.7 * math.sin(arm.angle) - 2.0 * math.radians(25))
    arm.velocity = 1.0
    assert weak(arm, 0.0) == pytest.approx(1.7 * math.sin(arm.angle) - 2.0 * math.radians(25) - 0.8 / math.sqrt(3))
    shaky = BEHAVIOURS["tremor"]
    assert max(shaky.torque(k / 1000) for k in range(1000)) == pytest.approx(1.5, abs=0.01)
