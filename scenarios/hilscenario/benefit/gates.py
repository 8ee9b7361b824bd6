"""What a bridge asks for in a session: the whole bridge in virtual time, with the gate in question.

The worn arm does not feed back into sensing, so every device of a session may be given what was asked, afterwards.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass, replace
from typing import NamedTuple

from hilbridge.confidence import MASKS, TREMOR_LEVELS, ConfidenceMaps, RisingMap, condition_of
from hilbridge.limits import MS
from hilbridge.records import Action
from hilbridge.rows import TickRow
from hilbridge.runtime.assemble import Parts
from hilbridge.verbs import NEVER_ASSISTED, VERBS
from hilbridge.wearer.person import Wearer
from hilscenario.benefit.visits import Visit, wearer_of
from hilscenario.format.files import scenario_of
from hilscenario.format.schema import Scenario
from hilscenario.lockstep.engine import Lockstep
from hilscenario.world.parts import parts_of

_ON_THE_WAY_MS = 2  # from the tick to the device: the bus, and the device's next millisecond
_AS_IT_IS = RisingMap((0.0, 1.0), (0.0, 1.0))
UNMAPPED = ConfidenceMaps({condition_of(mask, level): _AS_IT_IS for mask in MASKS for level in range(TREMOR_LEVELS)})


class Order(NamedTuple):
    """What a tick asks of the device: an ACT for a verb (its index), or None, a HOLD. `right` is None under HOLD."""

    at_ms: int
    verb: int | None
    right: bool | None


@dataclass(frozen=True)
class Gate:
    """A gate to compare. `temperature` divides the network's logits and stands in place of all calibration.

    Where it is None the bundle's own temperatures and maps hold. `tau_on` None: the bundle's.
    """

    name: str
    temperature: float | None = None
    tau_on: float | None = None


def parts_for(gate: Gate, scenario: Scenario) -> Parts:
    """Bundle and gate. Without calibration the numbers mean what the network says, whatever the tremor."""
    parts = parts_of(scenario)
    tau_on = parts.gate.tau_on if gate.tau_on is None else gate.tau_on
    config = replace(parts.gate, tau_on=tau_on, tau_off=tau_on - (parts.gate.tau_on - parts.gate.tau_off))
    if gate.temperature is None:
        return replace(parts, gate=config)
    raw = replace(parts.bundle, temperatures=dict.fromkeys(MASKS, gate.temperature), maps=UNMAPPED, usual=None)
    return replace(parts, bundle=raw, gate=replace(config, maps=UNMAPPED, usual=None))


def decided(visit: Visit, gate: Gate) -> list[TickRow]:
    """Every tick of the bridge in this session."""
    scenario = _scenario(visit)
    world = Lockstep(scenario, parts=parts_for(gate, scenario), wearer=wearer_of(visit))
    with closing(world.body):
        world.run()
    return world.bridge.ticks


def orders(rows: list[TickRow], wearer: Wearer) -> list[Order]:
    """What the ticks asked for."""
    return [_order(row.time_ns, row.verb if row.action is Action.ACT else None, wearer) for row in rows]


def always(rows: list[TickRow], wearer: Wearer) -> list[Order]:
    """An ACT for the likeliest verb at every tick that has one, whatever the gate says."""
    return [_order(row.time_ns, row.top_verb, wearer) for row in rows]


def without_wrong(asked: list[Order]) -> list[Order]:
    """The twin: HOLD in place of every ACT that was wrong."""
    return [Order(one.at_ms, None, None) if one.right is False else one for one in asked]


def _order(time_ns: int, verb: str | None, wearer: Wearer) -> Order:
    at_ms = time_ns // MS + _ON_THE_WAY_MS
    index = None if verb is None else VERBS.index(verb)
    if index is None or index in NEVER_ASSISTED:
        return Order(at_ms, None, None)
    return Order(at_ms, index, wearer.truth(time_ns).is_right(index))


def _scenario(visit: Visit) -> Scenario:
    return scenario_of(
        {
            "name": f"benefit {visit.seed}",
            "seed": visit.seed,
            "duration": f"{visit.seconds:g} s",
            "expect": [{"that": "always device.assist_nm <= 2.001"}],
        }
    )
