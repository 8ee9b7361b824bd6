"""Faults at many instants in every gate state on the whole system in lockstep, and planted defects that must be found."""

from __future__ import annotations

import tempfile
from pathlib import Path

from scenarios.campaign import GATE_STATES, base_scenario, run_campaign, samples_of
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
