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


@pytest.mark.parametrize("assisting", [False, True])
def test_ticks_made_at_once_leave_the_signals_of_ticks_made_one_by_one(assisting: bool) -> None:
    torque = (-80_000, 50_000) if assisting else (0, 0)
    rows = [(0.5 + 0.01 * number, 0.2 * number, *torque) for number in range(11)]
    logs, probes = [], []
    for at_once in (False, True):
        log = RunLog()
        probe, device = DeviceProbe(log.tracks, None), Device(ControllerState(b"k" * 16, 1))
        device.state.torque.assist_unm, device.state.torque.gravity_unm = torque
        device.ticks, device.state.last_tick_ms = 6, 106
        probe.look(device, 6 * MS, ())
        for number, (angle, velocity, *_) in enumerate(rows, 7):
            device.ticks, device.state.last_tick_ms = number, 100 + number
            device.arm.angle, device.arm.velocity = angle, velocity
            if not at_once:
                probe.look(device, number * MS, ())
        if at_once:
            probe.pass_by(device, [value for row in rows for value in row], 7 * MS, MS)
            probe.look(device, 17 * MS, ())
        logs.append(log.tracks.events)
        probes.append((probe.energy_j, probe.assist_ms))
    assert logs[0] == logs[1]
    assert probes[0] == probes[1]
