"""hilscenario.lockstep.probes: what is read off the device each millisecond."""

from __future__ import annotations

import pytest

from firmware_sim.device import Device
from firmware_sim.memory import ControllerState
from hilscenario.lockstep.probes import MS, DeviceProbe
from hilscenario.lockstep.run_log import RunLog


def test_energy_is_of_everything_an_act_adds() -> None:
    probe, device = DeviceProbe(RunLog().tracks, None), Device(ControllerState(b"k" * 16, 1))
    device.arm.velocity, device.state.torque.gravity_unm = 2.0, 50_000
    probe.look(device, MS, ())
    assert probe.energy_j == pytest.approx(0.05 * 2.0 * 1e-3)
    device.state.torque.assist_unm = -80_000
    probe.look(device, 2 * MS, ())
    assert probe.energy_j == pytest.approx((0.05 + 0.03) * 2.0 * 1e-3)
