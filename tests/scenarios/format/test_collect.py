"""hilscenario.format.collect: the catalogue is found whole, sweeps unfold."""

from __future__ import annotations

from hilscenario.format.collect import collect, unfold
from hilscenario.format.files import scenario_of
from hilscenario.format.vocabulary import FAULTS
from tests.scenarios.made import CATALOG, acting


def test_the_catalogue_is_readable_covers_every_hazard_and_has_at_least_thirty_scenarios() -> None:
    found = collect([CATALOG])
    assert len(found) >= 30
    assert len({scenario.name for _, scenario in found}) == len(found)
    assert {hazard for _, scenario in found for hazard in scenario.hazards} == {f"H{n}" for n in range(1, 10)}
    injected = {step.fault for _, scenario in found for step in scenario.steps}
    assert {fault for fault in FAULTS if fault.split(".")[0] in ("bus", "bridge", "device", "wearer")} <= injected
    for kind in ("off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent", "drift", "clock_skew"):
        assert any(fault.endswith(f".{kind}") for fault in injected), kind


def test_a_sweep_unfolds_into_its_points() -> None:
    data = acting({"fault": "bus.drop", "at": "1 s", "with": {"share": 0.5}}).model_dump(mode="json", by_alias=True)
    data["sweep"] = {"steps.0.with.share": [0.1, 0.9], "gate.tau_on": [0.7, 0.8, 0.9]}
    points = unfold(scenario_of({key: value for key, value in data.items() if value is not None}))
    assert len(points) == 6
    assert {point.steps[0].options["share"] for point in points} == {0.1, 0.9}
