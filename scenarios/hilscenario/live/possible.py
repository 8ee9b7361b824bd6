"""Which scenarios cannot run live, and which bus each needs. Pure."""

from __future__ import annotations

import sys
from typing import NamedTuple

from firmware_sim.attachment import parse_spec as device_spec
from hilbridge.bus.port.spec import BusSpec, parse_spec
from hilbridge.conformance.admission import admit_bus
from hilbridge.errors import InputError
from hilscenario.format.schema import BusPart, DevicePart, Scenario, Session
from hilscenario.format.vocabulary import WIRE_FAULTS
from hilscenario.world.arm import PUSHING
from hilscenario.world.device_faults import RESTART
from hilscenario.world.parts import bundle

# A wire that can be broken or full: the simulated bus's own. A kernel's vcan has none.
_NEED_A_WIRE = (*WIRE_FAULTS, "bus.babble")


class Impossible(NamedTuple):
    """Where in the scenario, as a location within the file, and why."""

    location: tuple[int | str, ...]
    why: str


def impossible_live(scenario: Scenario, spec: BusSpec, *, external: bool = False) -> Impossible | None:
    """The first thing that cannot be had live on this bus, or None; `external`: with a device of the user's own."""
    if external and (found := _impossible_outside(scenario)) is not None:
        return found
    simulated = spec.interface == "hilsim"
    for number, step in enumerate(scenario.steps):
        where = ("steps", number, "fault")
        if step.fault in _NEED_A_WIRE and not simulated:
            return Impossible(
                where, f"`{step.fault}` needs a wire that can be broken or full, {spec} has none; {_HILSIM}"
            )
    if scenario.bus.bitrate != BusPart().bitrate and not simulated:
        return Impossible(("bus", "bitrate"), f"{spec} has no bit rate that could be set; {_HILSIM}")
    if scenario.bus.bit_error_rate and not simulated:
        return Impossible(("bus", "bit_error_rate"), f"{spec} has no bits that could be hit; {_HILSIM}")
    if isinstance(scenario.intent, Session) and scenario.intent.features is not None:
        why = "recorded features pass by the sensors that run live; give `video` and `gaze`, or leave --live out"
        return Impossible(("intent", "features"), why)
    if isinstance(scenario.intent, Session) and scenario.intent.folder is not None:
        why = "a folder's sensors are played in virtual time; leave --live out"
        return Impossible(("intent", "folder"), why)
    if scenario.device.clock_ppm != DevicePart().clock_ppm:
        return Impossible(("device", "clock_ppm"), "a live device runs on this computer's clock; leave --live out")
    return None


def _impossible_outside(scenario: Scenario) -> Impossible | None:
    """The first fault that nobody can tell a device of the user's own."""
    for number, step in enumerate(scenario.steps):
        where = ("steps", number, "fault")
        if step.fault == RESTART:
            if scenario.device.reset_command is None:
                why = f"`{RESTART}` needs `device.reset_command`, a command that resets your device"
                return Impossible(where, why)
        elif step.fault.startswith("device.") or step.fault in PUSHING:
            return Impossible(where, f"`{step.fault}` is within the device or its arm, which is external; leave it out")
    return None


def live_bus(
    bus: str | None, *, live: bool, profile: bool, external: bool = False, on_a_bench: bool = False
) -> BusSpec | None:
    """The bus that `--live --bus` asks for; None for virtual time. Raises InputError for one that may reach a wire.

    A physical bus is for a device of the user's own that nobody wears (decision 404): live scenarios inject faults on purpose,
    and a simulated device would be a second one there.
    """
    if not live:
        if bus is not None:
            raise InputError(f"--bus {bus}: virtual time has a bus of its own; add --live, or leave --bus out")
        return None
    if profile:
        raise InputError("--profile: shows the parts of virtual time; leave it or --live out")
    spec = parse_spec(bus or "auto")
    if device_spec(str(spec)).physical:
        if not external:
            raise InputError(
                f"--bus {spec}: may reach a wire, and live scenarios inject faults; use vcan0 or hilsim:NAME, or add --device "
                "external for a device on a bench (`hilbridge run --arm` drives a real device)"
            )
        made_of = bundle().provenance
        admit_bus(str(spec), physical=True, on_a_bench=on_a_bench, origin=None if made_of is None else made_of.origin)
    if sys.platform == "win32":
        raise InputError("--live: needs SIGSTOP and forked processes, which Windows has not; leave --live out")
    return spec


_HILSIM = "use --bus hilsim:NAME, or leave --live out"
