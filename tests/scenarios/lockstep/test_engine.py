"""hilscenario.lockstep.engine: every fault takes effect, equal seeds give equal bytes, nothing makes the device unsafe."""

from __future__ import annotations

from pathlib import Path

import pytest

from hilscenario.format.files import load_scenario
from hilscenario.format.vocabulary import FAULTS
from hilscenario.lockstep.run import run_scenario
from tests.scenarios.made import CATALOG, acting


@pytest.mark.parametrize("fault", sorted(FAULTS))
def test_every_fault_of_the_vocabulary_takes_effect_and_none_makes_the_device_unsafe(fault: str) -> None:
    step: dict[str, object] = {"fault": fault, "when": "device.assist_nm != 0", "after": "300 ms"}
    if not FAULTS[fault].instant:
        step["for"] = "700 ms"
    if fault == "bus.replay":
        step["with"] = {"past_s": 0.5}
    result = run_scenario(acting(step)).result
    assert result.faults[0].worked
    assert result.passed, result.problems()


def test_a_fault_that_ends_leaves_another_of_the_same_part_as_it_is() -> None:
    both = run_scenario(
        acting(
            {"fault": "device.torque_bias", "at": "1.5 s", "for": "1500 ms", "with": {"bias_nm": 0.2}},
            {"fault": "device.actuator_lag", "at": "1.6 s", "for": "200 ms"},
            {"fault": "bus.cut", "at": "2.2 s", "for": "800 ms"},
            {"fault": "bus.bus_off", "at": "2.0 s"},
        )
    )
    bias, lag, cut, off = both.result.faults
    assert (bias.effects, lag.worked, cut.worked, off.worked) == (1500, True, True, True)
    heard = both.trace["device.state"][2600:2950]
    assert set(heard) <= {"Follow", "Latched"}  # still cut, though the chip came back meanwhile


def test_a_fault_that_never_takes_effect_fails_its_scenario() -> None:
    never = acting({"fault": "gaze.off", "when": "device.state == Passive"})
    result = run_scenario(never).result
    assert not result.passed
    assert result.problems() == ["fault gaze.off never took effect (0 injections)"]


@pytest.mark.parametrize("name", ["bus-lossy", "sensor-garbage-hands", "tremor-under-confidence"])
def test_equal_seeds_give_equal_bytes_and_others_do_not(name: str, tmp_path: Path) -> None:
    scenario = load_scenario(CATALOG / f"{name}.yaml").model_copy(update={"duration": 4_000_000_000})
    recordings = []
    for number, seed in enumerate((1, 1, 2)):
        path = tmp_path / f"{number}.mcap"
        run_scenario(scenario.model_copy(update={"seed": seed}), recording=path)
        recordings.append(path.read_bytes())
    assert recordings[0] == recordings[1] != recordings[2]
