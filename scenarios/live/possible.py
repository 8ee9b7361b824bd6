"""What a scenario may ask for that real processes and a real clock cannot give, and on which bus they can. Pure."""

from __future__ import annotations

from typing import NamedTuple

from hilbridge.bus.spec import BusSpec
from scenarios.schema import BusPart, DevicePart, Scenario

# A wire that can be broken: the simulated bus's own. A kernel's vcan has none.
_OF_THE_WIRE = ("bus.cut", "bus.bus_off")


class Impossible(NamedTuple):
    """Where in the scenario, as a location within the file, and why."""

    location: tuple[int | str, ...]
    why: str


def impossible_live(scenario: Scenario, spec: BusSpec) -> Impossible | None:
    """The first thing that cannot be had live on this bus, or None."""
    simulated = spec.interface == "hilsim"
    for number, step in enumerate(scenario.steps):
        where = ("steps", number, "fault")
        if step.fault in _OF_THE_WIRE and not simulated:
            return Impossible(where, f"`{step.fault}` needs a wire that can be broken, {spec} has none; {_HILSIM}")
    if scenario.bus.bitrate != BusPart().bitrate and not simulated:
        return Impossible(("bus", "bitrate"), f"{spec} has no bit rate that could be set; {_HILSIM}")
    if scenario.bus.bit_error_rate and not simulated:
        return Impossible(("bus", "bit_error_rate"), f"{spec} has no bits that could be hit; {_HILSIM}")
    if scenario.device.clock_ppm != DevicePart().clock_ppm:
        return Impossible(("device", "clock_ppm"), "a live device runs on this computer's clock; leave --live out")
    return None


_HILSIM = "use --bus hilsim:NAME, or leave --live out"
