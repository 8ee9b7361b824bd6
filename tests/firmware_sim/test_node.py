"""The process around the controller: keys, bus, catching up, commands, log; driven without a clock."""

from __future__ import annotations

import io
import json
import time
from pathlib import Path

import can
import pytest

from firmware_sim import frames, node
from firmware_sim.attachment import Arrival, Attachment, BusUnusable, Spec, parse_spec
from firmware_sim.frames import STOP
from firmware_sim.keys import KeyUnusable, load_key
from firmware_sim.memory import COUNT_STALL_TICKS, COUNT_TX_DROPPED, Received
from firmware_sim.node import main
from firmware_sim.plant.actuator import LAG_S
from firmware_sim.secoc import DEMO_KEY
from firmware_sim.states import Reason, State
from hilbridge.limits import MS
from tests.firmware_sim.shared import Clock, make

requirement = pytest.mark.requirement


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    fake = Clock()
    monkeypatch.setattr(node.time, "monotonic_ns", fake.monotonic_ns)
    monkeypatch.setattr(node.time, "sleep", fake.sleep)
    return fake


@requirement("S11")
def test_a_stalled_computer_is_caught_up_tick_by_tick_and_is_no_device_fault(clock: Clock) -> None:
    made, bus = make()
    clock.jumps = {100: 300}
    seen: list[tuple[int, int]] = []
    tick = made.device.tick

    def watched(received: tuple[Received, ...], *rest: int) -> tuple[tuple[int, bytes], ...]:
        seen.extend((made.device.ticks + 1, frame.can_id) for frame in received)
        return tick(received, *rest)

    made.device.tick = watched  # type: ignore[method-assign]
    start_ns = clock.now_ns
    bus.arrivals = [
        Arrival(start_ns + ms * MS - 1, Received(0x700 + k, b"")) for k, ms in enumerate((50, 150, 150, 260))
    ]
    made.run(0.5)
    assert made.device.ticks == 500
    assert seen == [(50, 0x700), (150, 0x701), (150, 0x702), (260, 0x703)]
    assert made.device.state.state == State.FOLLOW
    assert made.most_behind >= 300
    assert made.device.state.counters[COUNT_STALL_TICKS] >= 299
    assert made.summary()["rejected"] == {"unknown_id": 4}


@requirement("S11")
def test_frames_of_ticks_long_gone_are_not_sent_late(clock: Clock) -> None:
    made, bus = make()
    clock.jumps = {200: 400}
    made.run(1.0)
    assert bus.dropped > 0
    status = [data for can_id, data in bus.log if can_id == frames.CTRL_STATUS]
    assert 28 <= len(status) <= 40
    assert made.device.state.counters[COUNT_TX_DROPPED] == bus.dropped


def test_a_computer_that_never_catches_up_can_still_end_the_node(clock: Clock) -> None:
    made, _bus = make()
    clock.jumps = {100: 60_000}
    tick = made.device.tick

    def slow(*arguments: object) -> tuple[tuple[int, bytes], ...]:
        clock.now_ns += 2 * MS  # a tick that takes longer than the millisecond that it stands for
        if made.device.ticks == 500:
            made.stopping = True  # as SIGTERM does
        return tick(*arguments)  # type: ignore[arg-type]

    made.device.tick = slow  # type: ignore[method-assign]
    made.run(None)
    assert made.device.ticks == 501


def test_small_delays_are_not_counted_as_stalls(clock: Clock) -> None:
    made, _bus = make()
    clock.jumps = {100: 3}
    made.run(0.2)
    assert made.device.state.counters[COUNT_STALL_TICKS] == 0


def test_the_log_has_every_change_and_every_20_ms(clock: Clock) -> None:
    log = io.StringIO()
    made, _bus = make(log)
    made.run(0.2)
    lines = [json.loads(line) for line in log.getvalue().splitlines()]
    assert lines[0] == {"start_ns": 5_000_000_000}
    assert [line["t_ms"] for line in lines[1:]] == [1, 20, 40, 51, 60, 80, 100, 120, 140, 160, 180, 200]
    assert lines[4]["state"] == "Follow"
    assert {"assist_nm", "gravity_nm", "follow_nm", "accepted_ms", "reason"} <= set(lines[1])


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        ("overrun", Reason.TICK_OVERRUN),
        ("gain -1", Reason.TORQUE_TRACKING),
        ("encoder 9000", Reason.SENSOR_IMPLAUSIBLE),
    ],
)
def test_faults_typed_on_standard_input_reach_the_device(clock: Clock, command: str, reason: Reason) -> None:
    made, _bus = make()
    made.run(0.2)
    made.stopping = False
    made.commands.append(command)
    made.device.ticks = 200
    made.run(1.5)
    assert made.device.state.reason == reason


def test_other_commands(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    made, _bus = make()
    made.commands.extend(["stuck", "push 1.5", "busoff", "clear", "nonsense", "gain", "quit"])
    made._obey()
    assert made.device.actuator.stuck
    assert made.device.wearer_extra_nm == 1.5
    assert made.forced_bus_off
    assert made.device.local_clear
    assert made.stopping
    assert capsys.readouterr().err.count("not understood") == 2
    made.commands.append("buson")
    made._obey()
    assert not made.forced_bus_off


def test_faults_of_the_motor_add_up_until_mended(clock: Clock) -> None:
    made, _bus = make()
    made.commands.extend(["bias 0.5", "lag 60"])
    made._obey()
    assert (made.device.actuator.bias_nm, made.device.actuator.lag_s) == (0.5, 0.06)
    made.commands.append("mend")
    made._obey()
    assert (made.device.actuator.bias_nm, made.device.actuator.lag_s) == (0.0, LAG_S)


def test_the_log_has_every_command_typed_when_stop_came_and_a_line_every_cycle_asked_for(clock: Clock) -> None:
    log = io.StringIO()
    made, bus = make(log=log, log_cycle_ms=5)
    made.run(0.1)
    bus.arrivals.append(Arrival(clock.now_ns, Received(STOP, b"", True)))
    made.commands.append("push 1.5")
    made.stopping = False
    made.run(0.2)
    rows = [json.loads(line) for line in log.getvalue().splitlines()]
    assert [row["command"] for row in rows if "command" in row] == ["push 1.5"]
    states = [row for row in rows if "state" in row]
    assert len(states) >= 40
    stops = {row["stop_ms"] for row in states}
    assert len(stops) == 2
    assert next(row for row in states if row["state"] == "EStop")["t_ms"] == max(stop for stop in stops if stop)


@requirement("P12")
def test_key_files_must_be_private_and_keys(tmp_path: Path) -> None:
    path = tmp_path / "arm.key"
    path.write_text("00112233445566778899aabbccddeeff\n")
    path.chmod(0o640)
    with pytest.raises(KeyUnusable, match=f"chmod 600 {path}"):
        load_key(path, physical=True)
    path.chmod(0o600)
    assert load_key(path, physical=True) == bytes.fromhex("00112233445566778899aabbccddeeff")
    for text in ("0011", "not hexadecimal at all", "", "00112233445566778899aabbccddeeff00"):
        path.write_text(text)
        with pytest.raises(KeyUnusable, match="32 hexadecimal digits"):
            load_key(path, physical=False)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(KeyUnusable, match="cannot be read"):
        load_key(path, physical=False)
    with pytest.raises(KeyUnusable, match="no such key file"):
        load_key(tmp_path / "none", physical=False)


@requirement("P12")
def test_the_demo_key_is_refused_on_a_physical_bus_by_the_device_too(tmp_path: Path) -> None:
    assert load_key(None, physical=False) == DEMO_KEY
    path = tmp_path / "arm.key"
    path.write_text(DEMO_KEY.hex())
    path.chmod(0o600)
    for source in (None, path):
        with pytest.raises(KeyUnusable, match="refused on a physical bus"):
            load_key(source, physical=True)


@pytest.mark.parametrize(
    ("text", "spec"),
    [
        ("can0", Spec("socketcan", "can0", True)),
        ("vcan7", Spec("socketcan", "vcan7", False)),
        ("hilsim:demo", Spec("hilsim", "demo", False)),
        ("virtual:x", Spec("virtual", "x", False)),
        ("slcan:/dev/ttyUSB0", Spec("slcan", "/dev/ttyUSB0", True)),
    ],
)
def test_bus_specs(text: str, spec: Spec) -> None:
    assert parse_spec(text) == spec


@pytest.mark.parametrize("text", ["", ":x", "hilsim:"])
def test_bus_specs_nobody_can_read(text: str) -> None:
    with pytest.raises(BusUnusable, match="write auto"):
        parse_spec(text)


def test_the_attachment_reads_writes_and_survives_on_an_in_process_bus() -> None:
    mine = Attachment(Spec("virtual", "attachment-test", False))
    with can.Bus(interface="virtual", channel="attachment-test") as other:
        other.send(can.Message(arbitration_id=0x60, data=b"12345678", is_extended_id=False))
        other.send(can.Message(arbitration_id=0x60, data=b"", is_extended_id=True))
        other.send(can.Message(arbitration_id=0x140, is_error_frame=True))
        now_ns = time.monotonic_ns()
        arrivals = mine.read(now_ns)
        assert [arrival.frame for arrival in arrivals] == [
            Received(0x60, b"12345678"),
            Received(0x60, b"", plain=False),
        ]
        assert all(now_ns - 10**9 < arrival.arrived_ns <= now_ns for arrival in arrivals)
        assert not mine.bus_off
        other.send(can.Message(arbitration_id=0x40, is_error_frame=True))
        mine.read(now_ns)
        assert mine.bus_off
        mine.send(0xA0, b"abc", now_ns)
        heard = other.recv(1.0)
        assert heard is not None
        assert (heard.arbitration_id, bytes(heard.data), heard.is_extended_id) == (0xA0, b"abc", False)
    assert (mine.received, mine.sent, mine.dropped) == (2, 1, 0)
    mine.close()
    mine.close()


def test_a_lost_bus_is_opened_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    mine = Attachment(Spec("virtual", "lost-test", False))

    def broken(*_: object, **__: object) -> None:
        raise can.CanOperationError("gone")

    assert mine._bus is not None
    monkeypatch.setattr(mine._bus, "recv", broken)
    monkeypatch.setattr(mine._bus, "send", broken)
    mine.send(1, b"", 0)
    assert mine.dropped == 1
    assert mine.read(0) == []
    assert mine.link_errors == 1
    mine.send(1, b"", 50 * MS)  # not yet
    assert mine.dropped == 2
    assert mine.read(200 * MS) == []
    mine.send(1, b"", 200 * MS)
    assert mine.sent == 1
    mine.close()


def test_main_runs_and_ends_with_a_summary(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())
    log = tmp_path / "device.jsonl"
    assert main(["--bus", "virtual:main-test", "--seconds", "0.1", "--json-log", str(log)]) == 0
    out = capsys.readouterr().out.splitlines()
    assert out[0] == "firmware-sim ready on virtual:main-test, profiles A6127E08"
    assert json.loads(out[1].removeprefix("firmware-sim done "))["state"] == "Follow"
    assert len(log.read_text().splitlines()) >= 6


@pytest.mark.parametrize(
    ("arguments", "cure"),
    [
        (["--bus", "nosuchcan9"], "--bus hilsim:demo"),
        (["--bus", "udp_multicast:239.74.163.2"], "gives a node its own frames back"),
        (["--bus", "virtual:x", "--key-file", "/nonexistent/key"], "no such key file"),
        (["--bus", "virtual:x", "--json-log", "/nonexistent/log"], "log cannot be written"),
        (["--bus", "virtual:x", "--profiles", "/nonexistent/own.toml"], "own.toml: cannot be read"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(
    arguments: list[str], cure: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if arguments[1] == "nosuchcan9":
        key = tmp_path / "key"
        key.write_text("ab" * 16)
        key.chmod(0o600)
        arguments = [*arguments, "--key-file", str(key)]
    assert main([*arguments, "--seconds", "0.1"]) == 2
    error = capsys.readouterr().err.strip()
    assert cure in error
    assert "\n" not in error


def test_a_restart_forgets_everything_and_a_wrong_key_is_another_device(clock: Clock) -> None:
    made, _bus = make()
    made.run(0.2)
    before = made.device.state
    made.commands.append("wrongkey")
    made._obey()
    wrong = made.device.state
    assert wrong.shared_key != DEMO_KEY
    assert wrong.boot_nonce != before.boot_nonce
    made.commands.append("restart")
    made._obey()
    assert made.device.state.shared_key == DEMO_KEY
    assert made.device.state.boot_nonce != wrong.boot_nonce
    assert made.device.state.state == State.BOOT


def test_a_confirmation_that_comes_too_early_is_refused_aloud(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    made, _bus = make()
    made.device.state.state = State.ESTOP
    made.commands.append("clear")
    made.run(0.1)
    said = capsys.readouterr().out
    assert "clear refused: too early, waits for a bridge that authenticates clearing" in said
    assert "EStop (None): waits for a bridge" in said
    assert made.device.state.state == State.ESTOP
