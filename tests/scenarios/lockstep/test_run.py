"""hilscenario.lockstep.run: a recording changes nothing."""

from __future__ import annotations

from pathlib import Path

from hilscenario.lockstep.run import run_scenario
from tests.scenarios.made import acting


def test_a_recording_changes_no_signal(tmp_path: Path) -> None:
    """Rows that nobody keeps are not made; nothing else depends on them."""
    scenario = acting({"fault": "bus.drop", "at": "1 s", "for": "300 ms", "with": {"share": 0.5}}, duration="2 s")
    kept, unkept = run_scenario(scenario, recording=tmp_path / "one.mcap"), run_scenario(scenario)
    assert kept.ticks == unkept.ticks
    assert set(kept.trace.values) == set(unkept.trace.values)
    for name, values in kept.trace.values.items():
        assert list(values) == list(unkept.trace[name]), name
