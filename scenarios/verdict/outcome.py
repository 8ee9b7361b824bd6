"""What a judged run is: its result, the signals it was judged on, and the bridge's rows."""

from __future__ import annotations

from dataclasses import dataclass

from hilbridge.rows import MetaRow, TickRow
from scenarios.format.schema import Scenario
from scenarios.signals.bridge import BRIDGE_AT_REST
from scenarios.signals.device import DEVICE_AT_REST
from scenarios.signals.trace import Trace
from scenarios.verdict.figures import assist_rise_nm_s
from scenarios.verdict.judging import Result
from scenarios.world.parts import parts_of


@dataclass(frozen=True, slots=True)
class Run:
    """A result with the signals it was judged on and the bridge's rows, for reports."""

    result: Result
    trace: Trace
    ticks: list[TickRow]
    scenario: Scenario


def meta_row(scenario: Scenario, bus: str | None = None, start_ns: int | None = None) -> MetaRow:
    """Which scenario a recording is of; a live one names its bus, and its time 0 on the monotonic clock."""
    gate = parts_of(scenario).gate
    return MetaRow(
        0,
        bus=bus,
        tau_on=gate.tau_on,
        tau_off=gate.tau_off,
        scenario=scenario.name,
        seed=scenario.seed,
        start_ns=start_ns,
    )


def initial_values(scenario: Scenario) -> dict[str, float | str | bool]:
    """Every signal before anything has happened."""
    faults = {f"fault.{step.fault}": False for step in scenario.steps}
    return {**DEVICE_AT_REST, **BRIDGE_AT_REST, **faults, "fault.any": False}


def with_derived(trace: Trace) -> Trace:
    """Signals that follow from others."""
    values = {**trace.values, "device.assist_rise_nm_s": assist_rise_nm_s(trace)}
    return Trace(trace.step_ms, trace.length, values, trace.silent)
