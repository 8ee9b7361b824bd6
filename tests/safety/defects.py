"""Deliberate defects of controller, gate and link, each planted for one campaign that has to find it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from unittest import mock

import firmware_sim.controller
import firmware_sim.receive
import hilbridge.runtime.node
from firmware_sim import torque, watchdogs
from firmware_sim.law import damping
from firmware_sim.law.memory import Torque
from firmware_sim.law.numbers import div
from firmware_sim.states import TABLE, Event, State
from hilbridge.core import bridge, gate
from hilbridge.records import HoldReason
from hilscenario.campaign import GATE_STATES, Sample, base_scenario, scenario_for
from hilscenario.format.schema import Scenario
from hilscenario.lockstep.run import run_scenario
from tests.safety.table import REFERENCE
from tests.safety.tools.planting import spoilt


class _EqualToAll:
    """A MAC that every other one is equal to."""

    def __eq__(self, other: object) -> bool:
        return True

    def __ne__(self, other: object) -> bool:
        return False

    __hash__ = None  # type: ignore[assignment]


@dataclass(frozen=True)
class Defect:
    """What is planted where, and the fault under which it shows. `places` are (owner, attribute or key, value)."""

    name: str
    places: tuple[tuple[Any, Any, Any], ...]
    fault: str


def _slow_ramp(law: Torque, stride: int, velocity_mdeg_s: int) -> None:
    law.assist_unm = div(law.assist_unm * 98, 100)
    law.ramp_tick = 1


def _boundless(law: Torque, size: int, ceiling: int, velocity_mdeg_s: int) -> None:
    law.damping_unm = -100 * velocity_mdeg_s


DEFECTS: tuple[Defect, ...] = (
    Defect("command watchdog of ten seconds", ((watchdogs, "COMMAND_LIMIT_MS", 10_000),), "bridge.hang"),
    Defect(
        "an overdue command changes nothing",
        ((firmware_sim.controller, "command_overdue", lambda state, now_ms: None),),
        "bus.cut",
    ),
    Defect("ramps that take half a second", ((torque, "ramping", _slow_ramp),), "gaze.off"),
    Defect("any MAC is right", ((firmware_sim.receive.secoc, "act_mac", lambda *_: _EqualToAll()),), "bus.forge"),
    Defect(
        "no torque limit",
        ((damping, "damp", _boundless),),
        "bus.duplicate",
    ),
    Defect(
        "the bridge acts on stale sensing",
        (
            (gate, "estimate_problem", lambda config, estimate, now_ns: None),
            (bridge, "SENSING_LIMIT_MS", 10_000),
            (hilbridge.runtime.node, "first_problem", lambda sensors, now_ns: None),
        ),
        "camera.off",
    ),
    Defect(
        "the bridge acts unarmed",
        ((bridge.Bridge, "veto", lambda self, now_ns: HoldReason.NONE),),
        "bus.cut",
    ),
    Defect("STOP is ignored", ((TABLE[State.ASSIST], Event.STOP, State.ASSIST),), "bus.stop"),
    Defect("HOLD is ignored", ((TABLE[State.ASSIST], Event.HOLD, State.ASSIST),), "bus.duplicate"),
    Defect("a latch opens by itself", ((TABLE[State.LATCHED], Event.HOLD, State.FOLLOW),), "device.tick_overrun"),
    Defect(
        "straight back from RAMP_DOWN to ASSIST",
        ((TABLE[State.RAMP_DOWN], Event.RAMPED_CLEAN, State.ASSIST),),
        "bus.duplicate",
    ),
)


@contextmanager
def planted(defect: Defect) -> Iterator[None]:
    """The defect, for as long as this lasts. The reference runs meanwhile: the C would not have it."""
    with spoilt(defect.places), mock.patch.dict(os.environ, REFERENCE):
        yield


def scenarios_for(defect: Defect) -> list[Scenario]:
    """One injection in every gate state."""
    base = base_scenario()
    made = []
    for number, state in enumerate(GATE_STATES):
        for_ms = 0.0 if defect.fault in ("bus.stop", "device.tick_overrun") else 900.0
        made.append(scenario_for(base, Sample(defect.fault, state, 20.0, for_ms, 3000, number)))
    return made


def violated(scenario: Scenario) -> list[str]:
    """Names of the safety expectations that a run violates."""
    result = run_scenario(scenario).result
    return [judgement.name for judgement in result.judgements if judgement.safety and not judgement.holds]


def is_found(defect: Defect) -> bool:
    """Whether any of its scenarios violates a safety expectation while the defect is there."""
    with planted(defect):
        return any(violated(scenario) for scenario in scenarios_for(defect))


def is_clean(defect: Defect) -> bool:
    """Whether the same scenarios are safe without the defect: otherwise finding it would mean nothing."""
    return not any(violated(scenario) for scenario in scenarios_for(defect))
