"""scenarios.live without processes: what is refused, what logs say as signals, sources and intruder on a given clock."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import can
import pytest

from firmware_sim import frames as layout
from firmware_sim.attachment import parse_spec as device_spec
from hilbridge.bus.port.spec import parse_spec
from hilbridge.limits import MS
from hilbridge.records import Action, CameraFrame, GazeSample, HoldReason
from hilbridge.rows import CountersRow, MetaRow, TickRow
from scenarios import cli
from scenarios.format.collect import collect
from scenarios.format.files import dump_scenario, scenario_of
from scenarios.format.schema import Expectation, Scenario, Step
from scenarios.live.bridge.senses import EdgeSource
from scenarios.live.device_world import DeviceWorld
from scenarios.live.intruder import LiveIntruder
from scenarios.live.logs.bridge import missing_ticks, put_bridge
from scenarios.live.logs.device import assist_figures, device_columns
from scenarios.live.logs.happened import Happened
from scenarios.live.possible import impossible_live
from scenarios.live.run import judge_live, with_margin
from scenarios.runner import sort_out
from scenarios.signals.device import DeviceLine, device_line
from scenarios.signals.tracks import Tracks
from scenarios.verdict.judging import FaultCount
from scenarios.verdict.junit import write_junit
from scenarios.world.fault_board import Active, FaultBoard
from scenarios.world.sensing import CAMERA_PERIOD_NS, GAZE_PERIOD_NS, Body, edges

CATALOG = Path(__file__).parents[2] / "scenarios" / "catalog"
VCAN, HILSIM = parse_spec("vcan0"), parse_spec("hilsim:x")


def scenario(**more: Any) -> Scenario:
    base = {"name": "live", "duration": "1 s", "expect": [{"figure": "acts", "at_least": 0}]}
    return scenario_of({**base, **more})


# What cannot be had


@pytest.mark.parametrize(
    ("given", "location", "said", "on_hilsim"),
    [
        ({"steps": [{"fault": "bus.cut", "at": "1 ms"}]}, ("steps", 0, "fault"), "needs a wire", False),
        ({"steps": [{"fault": "bus.bus_off", "at": "1 ms"}]}, ("steps", 0, "fault"), "needs a wire", False),
        ({"steps": [{"fault": "bus.babble", "at": "1 ms"}]}, ("steps", 0, "fault"), "needs a wire", False),
        ({"bus": {"bitrate": 125000}}, ("bus", "bitrate"), "no bit rate", False),
        ({"bus": {"bit_error_rate": 1e-5}}, ("bus", "bit_error_rate"), "no bits", False),
        ({"device": {"clock_ppm": 100}}, ("device", "clock_ppm"), "this computer's clock", True),
        ({"intent": {"features": "a.npz"}}, ("intent", "features"), "give `video` and `gaze`", True),
    ],
)
def test_what_cannot_be_had_live_is_told_with_its_place_and_why(
    given: dict[str, Any], location: tuple[Any, ...], said: str, on_hilsim: bool
) -> None:
    cannot = impossible_live(scenario(**given), VCAN)
    assert cannot is not None
    assert cannot.location == location
    assert said in cannot.why
    assert (impossible_live(scenario(**given), HILSIM) is not None) == on_hilsim
    assert impossible_live(scenario(), VCAN) is None


def refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str) -> str:
    monkeypatch.setattr("sys.argv", ["hilscenario", "run", *words])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error


def test_a_file_that_cannot_run_live_is_one_line_with_file_and_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = CATALOG / "bus-cut.yaml"
    line = 1 + next(n for n, text in enumerate(path.read_text().splitlines()) if "fault: bus.cut" in text)
    error = refused(monkeypatch, capsys, str(path), "--live", "--bus", "vcan0")
    assert error.startswith(
        f"hilscenario: {path}:{line}: `bus.cut` needs a wire that can be broken or full, vcan0 has none"
    )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--live", "--bus", "can0"], "--bus can0: may reach a wire, and live scenarios inject faults"),
        (["--live", "--bus", "slcan:/dev/ttyACM0"], "may reach a wire"),
        (["--bus", "vcan0"], "--bus vcan0: virtual time has a bus of its own; add --live"),
        (["--live", "--bus", "hilsim:x", "--profile"], "--profile"),
        (["--live", "--bus", ":"], "write auto"),
        (["--live", "--bus", "vcan93"], "`ip link set vcan93 up`"),
    ],
)
def test_a_bus_that_will_not_do_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    assert said in refused(monkeypatch, capsys, str(CATALOG / "dropout-gaze-off.yaml"), *words)


def test_in_a_folder_what_cannot_run_is_skipped_and_told_everywhere(tmp_path: Path) -> None:
    able, skipped = sort_out(collect([CATALOG]), [], VCAN)
    files = {Path(one.file.rpartition(":")[0]).name for one in skipped}
    assert {"bus-125k.yaml", "bus-babble.yaml", "bus-bit-errors.yaml", "bus-cut.yaml", "bus-off.yaml"} <= files
    assert len(able) + len(skipped) == len(collect([CATALOG]))
    assert len(able) >= 40
    write_junit([], tmp_path / "junit.xml", skipped)
    text = (tmp_path / "junit.xml").read_text()
    assert f'skipped="{len(skipped)}"' in text
    assert text.count("<skipped ") == len(skipped)
    assert "needs a wire that can be broken or full" in text


def test_a_folder_of_which_nothing_can_run_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "cut.yaml").write_text(dump_scenario(scenario(steps=[{"fault": "bus.cut", "at": "1 ms"}])))
    assert "none of 1 scenarios can run live on vcan0" in refused(
        monkeypatch, capsys, str(tmp_path), "--live", "--bus", "vcan0"
    )


def test_skipped_ones_are_in_the_table_and_in_the_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, steps in (("cut", [{"fault": "bus.cut", "at": "1 ms"}]), ("fine", [])):
        (tmp_path / f"{name}.yaml").write_text(dump_scenario(scenario(name=name, steps=steps)))

    def at_once(asked: Scenario, spec: object, *, recording: Path | None, where: str) -> Any:
        return judge_live(asked, happened(), (), 1.0, where)

    monkeypatch.setattr("scenarios.runner.run_live", at_once)
    for words in ([], ["--json"]):
        monkeypatch.setattr("sys.argv", ["hilscenario", "run", str(tmp_path), "--live", "--bus", "vcan0", *words])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert ended.value.code == 0
    table, _, found = capsys.readouterr().out.rpartition("\n{")
    assert "1 of 1 passed, 1 skipped" in table
    assert "needs a wire that can be broken or full" in table
    assert [one["name"] for one in json.loads("{" + found)["skipped"]] == ["cut"]


# Logs as signals


def line(at_ms: int, state: str, assist_nm: float, **more: Any) -> DeviceLine:
    said = {
        "ends_ns": at_ms * MS,
        "t_ms": at_ms,
        "state": state,
        "reason": "None",
        "armed": True,
        "assist_nm": assist_nm,
        "gravity_nm": 0.0,
        "follow_nm": 0.0,
        "angle_deg": 1.0,
        "velocity_deg_s": 57.29578,
        "accepted_ms": 0,
        "accepted_live": False,
        "accepted_hold": False,
        "trips": 0,
        "stop_ms": None,
        "session": 1,
        "verb": 0,
        "accepted_counter": 0,
    }
    return device_line({**said, **more})


def test_words_hold_and_torque_is_straight_between_lines() -> None:
    rows = [line(0, "Ready", 0.0), line(10, "Assist", 0.0), line(20, "Assist", 1.0), line(30, "RampDown", 0.0)]
    columns = device_columns(rows, 0, 41)
    assert list(columns["device.state"][[0, 9, 10, 29, 30, 40]]) == ["Ready"] * 2 + ["Assist"] * 2 + ["RampDown"] * 2
    assert columns["device.assist_nm"][[10, 15, 20, 25, 30, 40]] == pytest.approx([0.0, 0.5, 1.0, 0.5, 0.0, 0.0])
    assert list(columns["device.assist_zero"][[19, 20, 29, 30]]) == [1.0, 0.0, 0.0, 1.0]
    figures = assist_figures(columns)
    assert figures["assist_s"] == pytest.approx(0.010)
    assert figures["assist_energy_j"] == pytest.approx(sum(1.0 - k / 10 for k in range(10)) * 1e-3)


def test_ages_are_on_the_devices_own_clock_and_grow_between_lines() -> None:
    act = {"accepted_live": True, "accepted_ms": 1005}
    hold = {"accepted_live": True, "accepted_ms": 1050, "accepted_hold": True}
    rows = [
        line(0, "Ready", 0.0, t_ms=1000),
        line(10, "Assist", 0.5, t_ms=1010, **act),
        line(50, "RampDown", 0.3, t_ms=1050, **hold),
        line(60, "EStop", 0.2, t_ms=1060, **hold, stop_ms=1058),
    ]
    columns = device_columns(rows, 0, 81)
    assert list(columns["device.act_age_ms"][[0, 10, 40, 70]]) == [1e6, 5.0, 35.0, 65.0]
    assert list(columns["device.hold_age_ms"][[40, 50, 80]]) == [0.0, 0.0, 30.0]
    assert list(columns["device.stop_age_ms"][[59, 60, 80]]) == [0.0, 2.0, 22.0]


def tick(at_ms: int, action: str) -> TickRow:
    return TickRow(at_ms * MS, Action[action], HoldReason.NONE, 0.9, armed=True, sensing_age_ms=30.0)


def test_a_bridge_that_says_nothing_for_100_ms_asks_for_nothing() -> None:
    tracks = Tracks()
    put_bridge(tracks, [tick(0, "ACT"), tick(40, "ACT"), tick(300, "ACT")], [])
    assert tracks.events["gate.act"] == [(0.0, True), (140.0, False), (300.0, True), (400.0, False)]
    assert [value for _, value in tracks.events["gate.reason"]] == ["none", "silent", "none", "silent"]


def test_a_bridge_that_is_hung_is_known_to_be() -> None:
    tracks = Tracks()
    put_bridge(tracks, [tick(0, "ACT"), tick(300, "ACT")], [(20 * MS, "hung")])
    assert [value for _, value in tracks.events["gate.reason"]][:3] == ["none", "hung", "none"]
    assert tracks.events["gate.act"][:3] == [(0.0, True), (20.0, False), (300.0, True)]


def test_a_hang_took_effect_as_often_as_ticks_are_missing() -> None:
    ticks = [tick(k * 40, "ACT") for k in range(10)]
    assert missing_ticks(ticks, 0, 400 * MS) == 0
    assert missing_ticks([*ticks[:2], *ticks[7:]], 80 * MS, 280 * MS) == 5
    assert missing_ticks(ticks, 81 * MS, 110 * MS) == 0


# Judging


def happened(lines: list[DeviceLine] | None = None, ticks: list[TickRow] | None = None) -> Happened:
    made = Happened(start_ns=0, device_lines=lines or [line(t_ms, "Follow", 0.0) for t_ms in range(0, 1000, 20)])
    made.bridge_rows = [*(ticks or [tick(0, "HOLD")])]
    return made


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
    first, second, third = (CountersRow(1, {"wire.LostFrames": lost}) for lost in (2, 3, 4))
    made.bridge_rows += [MetaRow(1), first, second, MetaRow(1), third]
    made.device_summary = {"lost_frames": 10}
    assert judge_live(scenario(), made, (), 1.0, "here").result.figures["frames_lost"] == 17.0


def test_only_the_time_to_zero_after_a_fault_has_a_margin_live() -> None:
    assert with_margin(Expectation(figure="zero_after_fault_ms", at_most=160)).at_most == 210
    assert with_margin(Expectation(figure="acts", at_most=3)).at_most == 3
    assert with_margin(Expectation(that="always gate.act")).that == "always gate.act"


# The device's world


def injected(*steps: tuple[str, dict[str, float]]) -> tuple[FaultBoard, DeviceWorld, list[str]]:
    board = FaultBoard(scenario(steps=[{"fault": fault, "at": "1 ms", "with": more} for fault, more in steps]).steps)
    typed: list[str] = []
    return board, DeviceWorld(board, typed.append), typed


def test_a_device_fault_that_ends_leaves_the_others_and_counts_only_what_the_device_obeyed() -> None:
    lag = ("device.actuator_lag", {"time_constant_ms": 50.0})
    board, world, typed = injected(lag, ("device.torque_bias", {"bias_nm": 0.5}))
    world.change(board.inject(0, 0))
    world.change(board.inject(1, 0))
    assert typed[-4:] == ["encoder 0", "mend", "lag 50", "bias 0.5"]
    world.saw(line(0, "Assist", 0.5).row)
    assert [active.effects for active in board.all] == [0, 0]  # typed, and not obeyed yet
    for command in typed[-4:]:
        world.obeyed(command)
    world.saw(line(5, "Assist", 0.5).row)
    world.saw(line(10, "Follow", 0.0).row)  # a lag does nothing to a motor that gives no torque
    assert [active.effects for active in board.all] == [1, 2]
    typed.clear()
    world.change(board.end(0))
    assert typed == ["encoder 0", "mend", "bias 0.5"]


def test_an_overrun_counts_when_it_is_obeyed_and_is_not_typed_again_at_its_end() -> None:
    board, world, typed = injected(("device.tick_overrun", {"overrun_ms": 8.0}))
    world.change(board.inject(0, 0))
    world.change(board.end(0))
    assert typed == ["overrun 8"]
    assert board.all[0].effects == 0
    world.obeyed("overrun 8")
    assert board.all[0].effects == 1


def test_the_wearer_pushes_against_the_assist_trembles_and_lets_go() -> None:
    board, world, typed = injected(
        ("wearer.opposing", {"torque_nm": 2.0}), ("wearer.tremor", {"hz": 5.0, "arm_deg": 2.0})
    )
    board.inject(0, 0)
    assert world.push(0.4, 0)
    assert world.push(-0.4, 0)
    assert world.push(0.0, 0)  # no assist, nothing to push against
    assert typed == ["push -2.0000", "push 2.0000", "push 0.0000"]
    board.inject(1, 0)
    assert world.push(0.4, 50 * MS)
    assert typed[-1] == "push -1.4000"
    board.end(0)
    board.end(1)
    assert not world.push(0.4, 50 * MS)
    assert typed[-1] == "push 0.0000"


# Sensors and intruder on a given clock


class Watched:
    """Runs a source on a clock of its own until `end_ns`; keeps what it delivers and when."""

    def __init__(self, source: EdgeSource[Any], clock: list[int], end_ns: int) -> None:
        self.got: list[tuple[int, Any]] = []

        def sleep_until(due_ns: int) -> bool:
            clock[0] = max(clock[0], due_ns)
            return clock[0] < end_ns

        source._sleep_until = sleep_until  # type: ignore[method-assign]
        source._deliver = lambda value, captured_ns: self.got.append((clock[0], value))  # type: ignore[method-assign]
        source._read_all()


def gaze_source(*steps: tuple[str, dict[str, float]], begin_ns: int = 0) -> tuple[EdgeSource[GazeSample], list[int]]:
    clock = [begin_ns]
    made = scenario(steps=[{"fault": fault, "at": "1 ms", "with": options} for fault, options in steps])
    board = FaultBoard(made.steps)
    for number in range(len(steps)):
        board.inject(number, 0)
    edge = edges(Body(made, board), board, 1)[1]
    return EdgeSource(edge, GAZE_PERIOD_NS, 1000 * MS, lambda: clock[0]), clock


def test_a_source_delivers_on_the_scenarios_grid_with_the_monotonic_clocks_stamps() -> None:
    source, clock = gaze_source()
    got = Watched(source, clock, 1200 * MS).got
    assert [when for when, _ in got] == [(1000 + 20 * k) * MS for k in range(10)]
    assert [sample.captured_ns for _, sample in got] == [when for when, _ in got]


def test_a_sensor_that_lags_delivers_true_stamps_late_and_loses_nothing() -> None:
    source, clock = gaze_source(("gaze.delayed", {"delay_ms": 50}))
    got = Watched(source, clock, 1200 * MS).got
    assert {when - sample.captured_ns for when, sample in got} == {50 * MS}
    assert [sample.captured_ns for _, sample in got] == [(1000 + 20 * k) * MS for k in range(8)]


def test_a_sensor_that_is_off_delivers_nothing_and_one_with_a_wrong_clock_stamps_with_it() -> None:
    source, clock = gaze_source(("gaze.off", {}))
    assert Watched(source, clock, 1200 * MS).got == []
    source, clock = gaze_source(("gaze.clock_skew", {"skew_ms": 200}))
    assert {sample.captured_ns - when for when, sample in Watched(source, clock, 1200 * MS).got} == {200 * MS}


def test_a_bridge_that_is_started_again_finds_the_wearer_where_time_has_gone() -> None:
    source, clock = gaze_source(begin_ns=5007 * MS)
    first, sample = Watched(source, clock, 5100 * MS).got[0]
    assert first == 5007 * MS
    assert sample.captured_ns == 5000 * MS
    made = scenario()
    body = Body(made, FaultBoard(()))
    assert (sample.x, sample.y) == (body.gaze(4000 * MS).x, body.gaze(4000 * MS).y)


def test_pictures_have_their_own_pace() -> None:
    made = scenario()
    board = FaultBoard(())
    clock = [0]
    camera: EdgeSource[CameraFrame] = EdgeSource(
        edges(Body(made, board), board, 1)[0], CAMERA_PERIOD_NS, 0, lambda: clock[0]
    )
    got = Watched(camera, clock, 200 * MS).got
    assert [when for when, _ in got] == [0, 40 * MS, 80 * MS, 120 * MS, 160 * MS]


@pytest.fixture
def other() -> Any:
    bus = can.Bus(interface="virtual", channel="intruder-test")
    yield bus
    bus.shutdown()


def heard(bus: can.BusABC) -> list[int]:
    found = []
    while (message := bus.recv(0)) is not None:
        found.append(message.arbitration_id)
    return found


def active(fault: str, **options: float) -> Active:
    return Active(Step.model_validate({"fault": fault, "at": "1 ms", "with": options}))


def test_the_intruder_sends_stop_three_times_babbles_and_forges_at_its_rate(other: can.BusABC) -> None:
    intruder = LiveIntruder(device_spec("virtual:intruder-test"), 1)
    stop, babble, forge = active("bus.stop"), active("bus.babble", per_s=1000), active("bus.forge", per_s=50)
    intruder.begin(stop, 0)
    intruder.end(stop)  # an instant is over at once; its three frames are not
    for now_ms in range(0, 40, 5):
        intruder.poll(now_ms * MS)
    assert heard(other) == [layout.STOP] * 3
    assert stop.effects == 3
    intruder.begin(babble, 0)
    for now_ms in range(0, 41, 4):
        intruder.poll(now_ms * MS)
    intruder.end(babble)
    intruder.poll(50 * MS)
    assert len(heard(other)) == babble.effects == 40
    intruder.begin(forge, 0)
    for now_ms in range(0, 100, 4):
        intruder.poll(now_ms * MS)
    intruder.end(forge)
    pairs = heard(other)
    assert pairs[:2] == [layout.ACT_CMD, layout.ACT_AUTH]
    assert len(pairs) == forge.effects == 10
    intruder.close()


def test_the_intruder_replays_what_it_heard_in_its_rhythm(other: can.BusABC) -> None:
    intruder = LiveIntruder(device_spec("virtual:intruder-test"), 1)
    for can_id in (layout.ACT_CMD, 0x7FF):  # of the bridge, and of nobody that matters
        other.send(can.Message(arbitration_id=can_id, data=b"12345678", is_extended_id=False))
    now_ns = time.monotonic_ns()
    intruder.poll(now_ns)
    replay = active("bus.replay", past_s=1.0)
    intruder.begin(replay, now_ns + 500 * MS)
    intruder.poll(now_ns + 900 * MS)
    assert heard(other) == []
    intruder.poll(now_ns + 1001 * MS)
    assert heard(other) == [layout.ACT_CMD]
    assert replay.effects == 1
    intruder.close()
