"""scenarios.lockstep.engine: the same run every time, every fault takes effect, and what the catalogue expects holds."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenarios.campaign import Sample, base_scenario, run_sample, samples_of, scenario_for
from scenarios.format.collect import collect, unfold
from scenarios.format.files import dump_scenario, load_scenario, scenario_of
from scenarios.format.schema import Scenario
from scenarios.format.vocabulary import FAULTS
from scenarios.lockstep.engine import MS, Lockstep
from scenarios.lockstep.run import run_scenario
from scenarios.minimise import minimise_scenario
from tests.safety.defects import DEFECTS, planted

CATALOG = Path(__file__).parents[2] / "scenarios" / "catalog"


def acting(*steps: dict[str, object], duration: str = "3.5 s") -> Scenario:
    return scenario_of(
        {
            "name": "test",
            "duration": duration,
            "intent": [{"at": "0.6 s", "verb": "Pour", "confidence": 0.97}],
            "gate": {"alpha": 0.6},
            "steps": list(steps),
            "expect": [{"figure": "acts", "at_least": 1}],
        }
    )


def test_the_devices_tick_takes_its_turn_among_those_of_one_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """First come, first served: what was planned before the last tick ended comes before it, what came later after."""
    scenario = acting(duration="5 ms")
    punctual = scenario.device.model_copy(update={"clock_ppm": 0.0})
    world = Lockstep(scenario.model_copy(update={"device": punctual}))
    said: list[str] = []
    monkeypatch.setattr(world.bridge, "start", lambda: None)
    monkeypatch.setattr(world, "_tick", lambda now_ns: said.append(f"tick {now_ns // MS}"))
    world.clock.at(3 * MS, lambda: said.append("early"))
    world.clock.at(2 * MS + 1, lambda: world.clock.at(3 * MS, lambda: said.append("late")))
    world.clock.at(1, lambda: world.clock.at(0, lambda: said.append("past")))
    world.run()
    assert said == ["past", "tick 1", "tick 2", "early", "tick 3", "late", "tick 4", "tick 5"]
    assert world.clock.time_ns == 5 * MS


def test_a_recording_changes_no_signal(tmp_path: Path) -> None:
    """Rows that nobody keeps are not made; nothing else depends on them."""
    scenario = acting({"fault": "bus.drop", "at": "1 s", "for": "300 ms", "with": {"share": 0.5}}, duration="2 s")
    kept, unkept = run_scenario(scenario, recording=tmp_path / "one.mcap"), run_scenario(scenario)
    assert kept.ticks == unkept.ticks
    assert set(kept.trace.values) == set(unkept.trace.values)
    for name, values in kept.trace.values.items():
        assert list(values) == list(unkept.trace[name]), name


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


def test_the_catalogue_is_readable_covers_every_hazard_and_has_at_least_thirty_scenarios() -> None:
    found = collect([CATALOG])
    assert len(found) >= 30
    assert len({scenario.name for _, scenario in found}) == len(found)
    assert {hazard for _, scenario in found for hazard in scenario.hazards} == {f"H{n}" for n in range(1, 10)}
    injected = {step.fault for _, scenario in found for step in scenario.steps}
    assert {fault for fault in FAULTS if fault.split(".")[0] in ("bus", "bridge", "device", "wearer")} <= injected
    for kind in ("off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent", "drift", "clock_skew"):
        assert any(fault.endswith(f".{kind}") for fault in injected), kind


def test_what_is_written_reads_back_equal(tmp_path: Path) -> None:
    for _, scenario in collect([CATALOG]):
        path = tmp_path / "again.yaml"
        path.write_text(dump_scenario(scenario))
        assert load_scenario(path) == scenario


def test_a_sweep_unfolds_into_its_points() -> None:
    data = acting({"fault": "bus.drop", "at": "1 s", "with": {"share": 0.5}}).model_dump(mode="json", by_alias=True)
    data["sweep"] = {"steps.0.with.share": [0.1, 0.9], "gate.tau_on": [0.7, 0.8, 0.9]}
    points = unfold(scenario_of({key: value for key, value in data.items() if value is not None}))
    assert len(points) == 6
    assert {point.steps[0].options["share"] for point in points} == {0.1, 0.9}


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


def test_campaign_samples_are_seeded_and_injected_in_the_named_gate_state() -> None:
    base = base_scenario()
    assert samples_of(base, 3, 7, ("bus.cut",)) == samples_of(base, 3, 7, ("bus.cut",))
    assert samples_of(base, 3, 7, ("bus.cut",)) != samples_of(base, 3, 8, ("bus.cut",))
    run = run_scenario(scenario_for(base, Sample("bus.cut", "turning to hold", 0.0, 400.0, 3000, 0)))
    injected = run.trace["fault.bus.cut"].astype(bool)
    assert run.trace["device.state"][injected][0] in ("RampDown", "Ready")
    assert run_sample(base, Sample("bus.cut", "acting", 100.0, 400.0, 3000, 0)).safe
