"""One scenario from its object to its result: run in lockstep, put on a grid, judge."""

from __future__ import annotations

import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from firmware_sim.memory import COUNT_TRIPS
from hilbridge.files import naming
from hilbridge.limits import MS
from hilbridge.observe.recording import Recording
from hilbridge.observe.signals import SignalRows
from hilbridge.rows import CountersRow
from hilscenario.format.schema import Scenario
from hilscenario.lockstep.engine import Lockstep
from hilscenario.lockstep.timing import Profile, profiled
from hilscenario.verdict.figures import figures_of_ticks, zero_after_fault_ms
from hilscenario.verdict.judging import FaultCount, Result, judged
from hilscenario.verdict.outcome import Run, first_rows, initial_values, with_derived
from hilscenario.verdict.safety import safety_expectations
from hilscenario.world.parts import codec


def run_scenario(
    scenario: Scenario, *, recording: Path | None = None, where: str = "scenario", profile: bool = False
) -> Run:
    """Run in virtual time and judge. recording: where to leave the MCAP file. Raises InputError."""
    parts: Profile | None = None

    def prepared(world: Lockstep) -> Lockstep:
        nonlocal parts
        parts = profiled(world) if profile else None
        return world

    cpu_s = time.process_time()
    if recording is None:
        world = prepared(Lockstep(scenario))
        with closing(world.body):
            world.run()
    else:
        with naming(recording), Recording(recording, SignalRows(codec())) as out:
            for row in first_rows(scenario):
                out.write(row)
            world = prepared(Lockstep(scenario, out.write))
            with closing(world.body):
                world.run()
            out.write(CountersRow(scenario.duration, world.counters()))
    cpu_s = time.process_time() - cpu_s
    run = judge_world(world, cpu_s, where)
    if parts is None:
        return run
    return replace(run, result=replace(run.result, profile=parts.per_second(scenario.duration / 1e9, cpu_s)))


def judge_world(world: Lockstep, cpu_s: float, where: str) -> Run:
    """Signals, figures and verdicts of a finished run."""
    scenario = world.scenario
    seconds = scenario.duration / 1e9
    trace = with_derived(world.log.tracks.trace(scenario.duration / MS, initial_values(scenario)))
    counters = world.device_side.device.state.counters
    figures = {
        **figures_of_ticks(world.bridge.ticks),
        "assist_s": world.device_side.probe.assist_ms / 1000.0,
        "assist_energy_j": world.device_side.probe.energy_j,
        "max_assist_nm": world.device_side.device.peak_assist_unm * 1e-6,
        "zero_after_fault_ms": zero_after_fault_ms(trace),
        "trips": float(counters[COUNT_TRIPS]),
        "frames_rejected": float(sum(counters[1:21])),
        "frames_lost": float(world.frames_lost),
    }
    judgements = judged(scenario.expect, trace, figures, safety=False, where=where)
    judgements += judged(safety_expectations(), trace, figures, safety=True, where=where)
    faults = tuple(FaultCount(*row) for row in world.board.effects())
    result = Result(scenario.name, scenario.seed, judgements, faults, figures, seconds, cpu_s)
    return Run(result, trace, world.bridge.ticks, scenario)
