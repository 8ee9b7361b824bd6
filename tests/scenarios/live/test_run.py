"""hilscenario.live.run: what a live run left is judged by the rules of virtual time, with the margins of two processes."""

from __future__ import annotations

from hilbridge.rows import CountersRow, MetaRow
from hilscenario.format.schema import Expectation, Scenario
from hilscenario.live.logs.happened import Happened
from hilscenario.live.run import judge_live, with_margin
from hilscenario.signals.device import DeviceLine
from hilscenario.verdict.judging import FaultCount
from tests.scenarios.made import happened, line, scenario, tick


def failed(scenario_: Scenario, made: Happened) -> set[str]:
    run = judge_live(scenario_, made, (), 1.0, "here")
    return {judgement.name for judgement in run.result.judgements if not judgement.holds}


def test_a_device_that_does_as_it_must_passes() -> None:
    assert failed(scenario(), happened()) == set()


def test_assist_that_outlives_its_command_is_found_on_the_recording() -> None:
    act = {"accepted_live": True, "accepted_ms": 100}
    rows = [line(0, "Ready", 0.0), *(line(t_ms, "Assist", 0.5, **act) for t_ms in range(300, 500, 5))]
    rows += [line(500, "Ready", 0.0, **act)]
    ticks = [tick(100, "ACT"), tick(140, "HOLD")]
    assert failed(scenario(), happened(rows, ticks)) >= {
        "command lost: zero assist within 150 ms",
        "the device assists only what the bridge asked for",
    }


def test_stamps_of_two_processes_agree_within_ten_milliseconds() -> None:
    act = {"accepted_live": True, "accepted_ms": 300}

    def rows(first_ms: int) -> list[DeviceLine]:
        on = [line(t_ms, "Assist", 0.01 * (t_ms - first_ms), **act) for t_ms in range(first_ms + 1, 360)]
        return [line(0, "Ready", 0.0), line(first_ms, "Ready", 0.0, **act), *on, line(360, "Ready", 0.0, **act)]

    ticks = [tick(300, "ACT"), tick(340, "HOLD")]
    name = "the device assists only what the bridge asked for"
    assert name not in failed(scenario(), happened(rows(296), ticks))
    assert name in failed(scenario(), happened(rows(280), ticks))


def test_a_process_that_ends_by_itself_fails_the_run() -> None:
    made = happened()
    made.died.append("bridge (exit code 1)")
    assert failed(scenario(), made) == {"no process ends by itself: bridge (exit code 1)"}


def test_a_fault_that_never_took_effect_fails_a_live_run_too() -> None:
    result = judge_live(scenario(), happened(), (FaultCount("gaze.off", 1, 0),), 1.0, "here").result
    assert not result.passed


def test_lost_frames_are_summed_over_a_bridge_that_was_started_again() -> None:
    made = happened()
    first, second, third = (CountersRow(1, {"frames_lost": lost}) for lost in (2, 3, 4))
    made.bridge_rows += [MetaRow(1), first, second, MetaRow(1), third]
    made.device_summary = {"lost_frames": 10}
    assert judge_live(scenario(), made, (), 1.0, "here").result.figures["frames_lost"] == 17.0


def test_only_the_time_to_zero_after_a_fault_has_a_margin_live() -> None:
    assert with_margin(Expectation(figure="zero_after_fault_ms", at_most=160)).at_most == 210
    assert with_margin(Expectation(figure="acts", at_most=3)).at_most == 3
    assert with_margin(Expectation(that="always gate.act")).that == "always gate.act"
