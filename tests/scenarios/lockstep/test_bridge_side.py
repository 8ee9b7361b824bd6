"""hilscenario.lockstep.bridge_side: a bridge that does not run asks for nothing."""

from __future__ import annotations

import pytest

from hilscenario.lockstep.run import run_scenario
from tests.safety.defects import DEFECTS, planted
from tests.scenarios.made import acting


@pytest.mark.parametrize(
    ("fault", "why"), [("bridge.hang", "hung"), ("bridge.stall", "stalled"), ("bridge.kill", "dead")]
)
def test_a_bridge_that_does_not_run_asks_for_nothing(fault: str, why: str) -> None:
    step: dict[str, object] = {"fault": fault, "when": "device.assist_nm != 0", "after": "300 ms"}
    if fault != "bridge.kill":
        step["for"] = "700 ms"
    trace = run_scenario(acting(step)).trace
    begin = int(trace[f"fault.{fault}"].argmax())
    away = slice(begin, begin + (690 if fault != "bridge.kill" else trace.length))
    assert trace["gate.act"][begin - 1]
    assert not trace["gate.act"][away].any()
    assert not trace["bridge.armed"][away].any()
    assert set(trace["gate.reason"][away]) == {why}
    assert fault == "bridge.kill" or trace["gate.act"][begin + 700 :].any()


def test_assist_that_goes_on_while_the_bridge_hangs_is_assist_nobody_asks_for() -> None:
    watchdog = next(defect for defect in DEFECTS if defect.name.startswith("command watchdog"))
    hang: dict[str, object] = {"fault": "bridge.hang", "when": "device.assist_nm != 0", "after": "300 ms", "for": "1 s"}
    with planted(watchdog):
        result = run_scenario(acting(hang)).result
    failed = {judgement.name for judgement in result.judgements if not judgement.holds}
    assert "the device assists only what the bridge asked for" in failed
