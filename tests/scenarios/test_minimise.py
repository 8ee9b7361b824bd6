"""hilscenario.minimise: of many faults the one that matters is left."""

from __future__ import annotations

import pytest

from hilbridge.errors import InputError
from hilscenario.format.files import scenario_of
from hilscenario.format.schema import Scenario
from hilscenario.minimise import minimise_scenario
from tests.safety.defects import DEFECTS, planted
from tests.scenarios.made import acting


def test_a_planted_failure_with_six_faults_is_minimised_to_the_one_that_matters() -> None:
    others = ("wearer.blink", "bus.duplicate", "hands.off", "device.actuator_lag", "gaze.drift")
    steps: list[dict[str, object]] = [
        {"fault": fault, "at": f"{1.2 + 0.05 * number} s", "for": "300 ms"} for number, fault in enumerate(others)
    ]
    steps.insert(3, {"fault": "bridge.hang", "at": "1.6 s", "for": "900 ms"})
    watchdog = next(defect for defect in DEFECTS if defect.name.startswith("command watchdog"))
    with planted(watchdog):
        small = minimise_scenario(acting(*steps))
    assert [step.fault for step in small.steps] == ["bridge.hang"]
    assert small.duration < 3_000_000_000


def test_it_names_the_violation_that_it_keeps_and_keeps_that_one_alone() -> None:
    scenario = scenario_of(
        {
            "name": "two ways to fail",
            "duration": "4 s",
            "intent": [{"at": "1 s", "verb": "Pour", "confidence": 0.97}],
            "steps": [{"at": "1 s", "fault": "bus.cut"}, {"at": "2 s", "fault": "bridge.kill"}],
            "expect": [{"that": "always device.assist_nm <= 2.001"}],
        }
    )

    def fails(candidate: Scenario) -> frozenset[str]:
        faults = {step.fault for step in candidate.steps}
        return frozenset(
            {"a cut" for fault in faults if fault == "bus.cut"} | {"b kill" for fault in faults if "kill" in fault}
        )

    said: list[str] = []
    small = minimise_scenario(scenario, fails, said.append)
    assert [step.fault for step in small.steps] == ["bus.cut"]
    assert said[0] == "keeps the violation of `a cut`, not of `b kill` (--keep chooses)"
    small = minimise_scenario(scenario, fails, keep="kill")
    assert [step.fault for step in small.steps] == ["bridge.kill"]
    with pytest.raises(InputError, match="violated are `a cut`, `b kill`"):
        minimise_scenario(scenario, fails, keep="nothing of the kind")
