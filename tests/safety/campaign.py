"""Faults at many instants in every gate state on the whole system in lockstep, and planted defects that must be found."""

from __future__ import annotations

import hashlib
import os
import tempfile
from pathlib import Path

import joblib

from hilscenario.campaign import GATE_STATES, base_scenario, run_campaign, samples_of
from hilscenario.format.collect import collect
from hilscenario.format.schema import Scenario
from hilscenario.lockstep.run import run_scenario
from hilscenario.runner import file_name
from tests.safety.defects import DEFECTS, is_clean, is_found
from tests.safety.table import Row, Scale

FAULTS = (
    "bridge.hang",
    "bridge.kill",
    "bridge.restart",
    "bridge.stall",
    "bus.bus_off",
    "bus.corrupt",
    "bus.cut",
    "bus.delay",
    "bus.drop",
    "bus.duplicate",
    "bus.forge",
    "bus.reorder",
    "bus.replay",
    "bus.stale_queue",
    "bus.stop",
    "camera.clock_skew",
    "camera.delayed",
    "camera.off",
    "camera.stuck",
    "device.actuator_lag",
    "device.sensor_fault",
    "device.tick_overrun",
    "device.torque_bias",
    "gaze.off",
    "gaze.clock_skew",
    "wearer.opposing",
)


CATALOG = Path(__file__).parents[2] / "scenarios" / "catalog"


def _digest(path: Path, scenario: Scenario, folder: Path) -> str:
    recording = folder / f"{path.stem}-{file_name(scenario.name)}.mcap"
    run_scenario(scenario, recording=recording)
    return hashlib.sha256(recording.read_bytes()).hexdigest()


def repeated() -> Row:
    """Every scenario of the catalogue recorded twice: one at a time, and with more processes than cores."""
    found = collect([CATALOG])
    digests = []
    for jobs in (1, 2 * (os.cpu_count() or 1)):
        with tempfile.TemporaryDirectory() as folder:
            calls = [joblib.delayed(_digest)(path, scenario, Path(folder)) for path, scenario in found]
            digests.append(joblib.Parallel(n_jobs=jobs)(calls))
    equal = sum(first == second for first, second in zip(*digests, strict=True))
    return Row(
        "campaign",
        "every catalogue scenario recorded twice, once with all cores busy: the same bytes",
        f"{equal} of {len(found)} equal",
        equal == len(found),
    )


def run(scale: Scale) -> list[Row]:
    """26 fault classes x 200 instants x 4 gate states; the quick part takes one instant of each fault."""
    base, instants = base_scenario(), scale.of(200, 1)
    samples = samples_of(base, instants, scale.seed, FAULTS)
    if scale.quick:
        samples = samples[:: len(GATE_STATES) + 1]
    with tempfile.TemporaryDirectory() as folder:
        outcomes = run_campaign(base, samples, Path(folder), jobs=1 if scale.quick else -1)
    bad = [outcome for outcome in outcomes if not outcome.safe]
    idle = sorted({outcome.sample.fault for outcome in outcomes if not outcome.took_effect})
    worst = min(outcome.robustness for outcome in outcomes)
    detail = f"; first: {bad[0].sample.key} {bad[0].problems}" if bad else ""
    found = sum(map(is_found, DEFECTS))
    clean = sum(map(is_clean, DEFECTS))
    return [
        *([] if scale.quick else [repeated()]),
        Row(
            "campaign",
            f"{len(FAULTS)} fault classes x {instants} instants x {len(GATE_STATES)} gate states: no safety violation",
            f"{len(bad)} of {len(outcomes)} unsafe, smallest margin {worst:.2g}"
            + (f", without effect at times: {', '.join(idle)}" if idle else "")
            + detail,
            not bad,
        ),
        Row(
            "campaign",
            "deliberate defects planted in controller, gate and link: each found, no alarm without one",
            f"{found} of {len(DEFECTS)} found, {clean} of {len(DEFECTS)} clean without",
            found == clean == len(DEFECTS),
        ),
    ]
