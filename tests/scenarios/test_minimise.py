"""scenarios.minimise: of many faults the one that matters is left."""

from __future__ import annotations

from scenarios.minimise import minimise_scenario
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
