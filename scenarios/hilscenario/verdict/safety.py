"""What must hold in every scenario, whatever it injects: the safety contract as formulas over the device's signals."""

from __future__ import annotations

from hilscenario.format.schema import Expectation

# name -> formula. Margins are those of docs/protocol.md; a device clock that drifts by 500 ppm stays inside them.
SAFETY: dict[str, str] = {
    "command lost: zero assist within 150 ms": "always (device.assist_zero or device.act_age_ms <= 150)",
    "HOLD: zero assist within 60 ms": "always (device.assist_zero or device.hold_age_ms <= 60)",
    "STOP: zero assist within 20 ms": "always (device.assist_zero or device.stop_age_ms <= 20)",
    "assist never above the largest cap": "always abs(device.assist_nm) <= 2.001",
    "assist rises by at most 10 N m/s": "always device.assist_rise_nm_s <= 10.01",
    "assist only in ASSIST and on the way out": (
        "always (device.assist_zero or device.state == Assist or device.state == RampDown"
        " or device.state == Latched or device.state == EStop or device.state == Passive)"
    ),
    "no assist without an armed session": "always (device.state == Assist -> device.armed)",
    "the bridge acts only on sensing of 150 ms at most": "always (gate.act -> bridge.sensing_age_ms <= 150)",
    "the bridge acts only when armed": "always (gate.act -> bridge.armed)",
    "no ACT until sensing was whole for 400 ms": "always (gate.act -> historically[0, 399 ms] bridge.sensors_well)",
    "the device assists only what the bridge asked for": ("always (device.assist_zero or once[0, 200 ms] gate.act)"),
    "assist ends after 10 s": "always not historically[0, 10.1 s] device.state == Assist",
    "no way into ASSIST but from READY": (
        "always (rise(device.state == Assist) -> once[0, 2 ms] device.state == Ready)"
    ),
    "a latch stays": (
        "always (rise(device.state == Latched) -> always (device.state == Latched or device.state == EStop))"
    ),
}


# Live, bridge and device stamp on their own: a frame may seem to arrive a little before it was decided on. They agree
# within the 10 ms of margin that a live process has. All other formulas look at one side only.
_LIVE: dict[str, str] = {
    "the device assists only what the bridge asked for": (
        "always (device.assist_zero or once[0, 200 ms] gate.act or eventually[0, 10 ms] gate.act)"
    ),
}


# A device that is only heard tells its state every 20 ms and torque in steps of 20 mN m: so much later, and so much rougher.
_BY_BUS: dict[str, str] = {
    "command lost: zero assist within 150 ms": "always (device.assist_zero or device.act_age_ms <= 170)",
    "HOLD: zero assist within 60 ms": "always (device.assist_zero or device.hold_age_ms <= 80)",
    "STOP: zero assist within 20 ms": "always (device.assist_zero or device.stop_age_ms <= 40)",
    "assist never above the largest cap": "always abs(device.assist_nm) <= 2.021",
    "assist rises by at most 10 N m/s": "always device.assist_rise_nm_s <= 12",
    "the device assists only what the bridge asked for": (
        "always (device.assist_zero or once[0, 220 ms] gate.act or eventually[0, 10 ms] gate.act)"
    ),
}


def safety_expectations(*, live: bool = False, by_bus: bool = False) -> tuple[Expectation, ...]:
    """The contract as expectations, in their order; `live` for signals stamped by two processes, `by_bus` for a device
    that is heard and has no log.
    """
    formulas = SAFETY | (_LIVE if live else {}) | (_BY_BUS if by_bus else {})
    return tuple(Expectation(that=formula, name=name) for name, formula in formulas.items())
