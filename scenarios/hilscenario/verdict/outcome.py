"""What a judged run is: its result, the signals it was judged on, and the bridge's rows."""

from __future__ import annotations

from dataclasses import dataclass

import hilbridge
from hilbridge.rows import MetaRow, Row, TickRow
from hilbridge.runtime.provenance import bundle_row, config_row, revision
from hilscenario.format.schema import Scenario, Session
from hilscenario.signals.bridge import BRIDGE_AT_REST
from hilscenario.signals.device import DEVICE_AT_REST
from hilscenario.signals.trace import Trace
from hilscenario.verdict.figures import assist_rise_nm_s
from hilscenario.verdict.judging import Result
from hilscenario.world.parts import parts_of


@dataclass(frozen=True, slots=True)
class Run:
    """A result with the signals it was judged on and the bridge's rows, for reports."""

    result: Result
    trace: Trace
    ticks: list[TickRow]
    scenario: Scenario


def first_rows(scenario: Scenario, bus: str | None = None, start_ns: int | None = None) -> tuple[Row, ...]:
    """What a scenario's recording begins with; a live one names its bus, and its time 0 on the monotonic clock."""
    parts = parts_of(scenario)
    meta = MetaRow(
        0,
        bus=bus,
        tau_on=parts.gate.tau_on,
        tau_off=parts.gate.tau_off,
        scenario=scenario.name,
        seed=scenario.seed,
        start_ns=start_ns,
        version=hilbridge.__version__,
        revision=revision(),
    )
    settings = scenario.model_dump(mode="json", by_alias=True, exclude={"expect", "sweep"}, exclude_none=True)
    return meta, config_row({"scenario": settings}, parts, 0), bundle_row(parts, 0, _intent(scenario))


def _intent(scenario: Scenario) -> str:
    """Where beliefs come from, in the words of BundleRow."""
    if isinstance(scenario.intent, tuple):
        return "script"
    recorded = isinstance(scenario.intent, Session) and scenario.intent.replays_beliefs
    return "recording" if recorded else "predictor"


def initial_values(scenario: Scenario) -> dict[str, float | str | bool]:
    """Every signal before anything has happened."""
    faults = {f"fault.{step.fault}": False for step in scenario.steps}
    return {**DEVICE_AT_REST, **BRIDGE_AT_REST, **faults, "fault.any": False}


def with_derived(trace: Trace) -> Trace:
    """Signals that follow from others."""
    values = {**trace.values, "device.assist_rise_nm_s": assist_rise_nm_s(trace)}
    return Trace(trace.step_ms, trace.length, values, trace.silent)
