"""`firmware-sim` as a program: what it takes, what it refuses in one line, what signals do, what a full disk does."""

from __future__ import annotations

import io
import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from firmware_sim import frames, node
from firmware_sim.node import main
from firmware_sim.plant.arm import WEARERS
from firmware_sim.profile_file import SHIPPED, read


class QuietBus:
    """A bus on which nothing happens; keeps what was sent."""

    made: list[QuietBus]
    asked: list[str]

    def __init__(self, spec: Any) -> None:
        self.spec = spec
        self.log: list[tuple[int, bytes]] = []
        self.received = self.sent = self.dropped = self.link_errors = self.closed = self.reads = 0
        self.bus_off = False
        QuietBus.made.append(self)

    def read(self, now_ns: int) -> list[Any]:
        self.reads += 1
        assert self.reads < 500, "a loop that never ends"
        return []

    def send(self, can_id: int, data: bytes, now_ns: int) -> None:
        self.log.append((can_id, data))

    def close(self) -> None:
        self.closed += 1


@pytest.fixture
def quiet(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[QuietBus]]:
    """Buses that were opened; signal handlers are put back afterwards."""
    QuietBus.made = []
    monkeypatch.setattr(node, "Attachment", QuietBus)
    QuietBus.asked = []
    monkeypatch.setattr(node, "use_realtime_scheduling", lambda: QuietBus.asked.append("real time"))
    monkeypatch.setattr(node, "read_terminal_politely", lambda: QuietBus.asked.append("polite"))
    monkeypatch.setattr("sys.stdin", io.StringIO())

    def nobody_minds(number: int, frame: FrameType | None) -> None:
        raise AssertionError(number)

    handled = (signal.SIGTERM, signal.SIGINT, signal.SIGUSR1)
    before = {number: signal.signal(number, nobody_minds) for number in handled}
    yield QuietBus.made
    for number, handler in before.items():
        signal.signal(number, handler)


def device(*arguments: str) -> int:
    return main(["--bus", "virtual:quiet", *arguments])


@pytest.mark.requirement("P6")
def test_h1_every_start_of_the_program_draws_its_boot_nonce(quiet: list[QuietBus]) -> None:
    for _ in range(6):
        assert device("--seconds", "0.02") == 0
    said = {frames.unpack(can_id, data)[1][1] for bus in quiet for can_id, data in bus.log if can_id == frames.CTRL_HB}
    assert len(said) == 6
    assert max(said) > 0xFFFF  # 1 in 2^96 that six fair ones all lie below


@pytest.mark.requirement("P6")
def test_h1_the_boot_nonce_is_32_bits_of_the_system(quiet: list[QuietBus], monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def randbits(bits: int) -> int:
        asked.append(bits)
        return 0xFEDCBA98

    monkeypatch.setattr(node.secrets, "randbits", randbits)
    assert device("--seconds", "0.02") == 0
    assert asked == [32]
    said = [frames.unpack(can_id, data)[1][1] for can_id, data in quiet[0].log if can_id == frames.CTRL_HB]
    assert set(said) == {0xFEDCBA98}


def test_it_says_where_it_is_ready_and_leaves_the_bus(
    quiet: list[QuietBus], capsys: pytest.CaptureFixture[str]
) -> None:
    assert device("--seconds", "0.01") == 0
    ready, done = capsys.readouterr().out.splitlines()
    assert ready == "firmware-sim ready on virtual:quiet, profiles A6127E08"
    assert json.loads(done.removeprefix("firmware-sim done "))["seconds"] == 0.01
    assert quiet[0].closed == 1
    assert QuietBus.asked == ["real time", "polite"]


def test_its_help_has_its_name(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        device("--help")
    assert capsys.readouterr().out.startswith("usage: firmware-sim [")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--seconds", "0"], "0: give seconds above 0"),
        (["--seconds", "-1"], "-1: give seconds above 0"),
        (["--seconds", "nan"], "nan: give seconds above 0"),
        (["--seconds", "1e9"], "1e9: give seconds above 0"),
        (["--seconds", "soon"], "invalid _seconds value: 'soon'"),
        (["--log-ms", "0"], "invalid choice: 0"),
        (["--log-ms", "1001"], "invalid choice: 1001"),
        (["--wearer-torque", "dance"], "invalid choice: 'dance'"),
        (["--nonsense"], "unrecognized arguments: --nonsense"),
    ],
)
def test_what_it_does_not_take_is_one_line(
    quiet: list[QuietBus], arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as raised:
        device(*arguments)
    assert raised.value.code == 2
    said = capsys.readouterr().err
    assert said.startswith("firmware-sim: ")
    assert said.endswith("; firmware-sim --help lists what there is\n")
    assert says in said
    assert said.count("\n") == 1


def test_what_it_takes(
    quiet: list[QuietBus], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made: list[tuple[Any, ...]] = []
    by_line: list[bool] = []  # so that a log has what happened until the end, whatever ends it
    real = node.Node.__init__

    def noted(self: node.Node, *arguments: Any) -> None:
        made.append(arguments)
        by_line.append(arguments[2] is None or arguments[2].line_buffering)
        real(self, *arguments)

    monkeypatch.setattr(node.Node, "__init__", noted)
    key = tmp_path / "key"
    key.write_text("ab" * 16)
    key.chmod(0o600)
    assert device("--seconds", "0.01") == 0
    log = tmp_path / "log"
    more = ["--key-file", str(key), "--json-log", str(log), "--log-ms", "1", "--wearer-torque", list(WEARERS)[-1]]
    own = tmp_path / "own.toml"
    own.write_text(SHIPPED.read_text(encoding="utf-8").replace("cap_mnm = 2000", "cap_mnm = 1000"), encoding="utf-8")
    assert device("--seconds", "0.02", *more, "--profiles", str(own)) == 0
    (plain, _bus, none, cycle), (told, _other, file, quick) = made
    assert (plain.state.profiles, told.state.profiles) == (read(), read(own))
    assert f", profiles {read(own).hash32:08X}\n" in capsys.readouterr().out
    assert (plain.state.shared_key, none, cycle) == (b"hilbridge-demo-k", None, 20)
    assert (told.state.shared_key, quick) == (b"\xab" * 16, 1)
    assert file.closed
    assert by_line == [True, True]
    assert plain.muscles.args == ("reach",)
    assert told.muscles.args == (list(WEARERS)[-1],)
    assert len(log.read_text().splitlines()) == 21
    parsed = node._parser().parse_args(["--log-ms", "1000", "--seconds", "999999999"])
    assert (parsed.bus, parsed.log_ms, parsed.interactive, parsed.until_input_ends) == ("auto", 1000, False, False)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_cleanly(
    quiet: list[QuietBus], number: signal.Signals, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    reads = iter(range(1000))

    def read(self: QuietBus, now_ns: int) -> list[Any]:
        if next(reads) == 3:
            os.kill(os.getpid(), number)
        return []

    monkeypatch.setattr(QuietBus, "read", read)
    assert device("--seconds", "5") == 0
    done = json.loads(capsys.readouterr().out.splitlines()[-1].removeprefix("firmware-sim done "))
    assert done["seconds"] < 5
    assert quiet[0].closed == 1


def test_the_users_signal_is_the_hand_at_the_device(
    quiet: list[QuietBus], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    reads = iter(range(1000))

    def read(self: QuietBus, now_ns: int) -> list[Any]:
        if next(reads) == 1:
            os.kill(os.getpid(), signal.SIGUSR1)
        return []

    monkeypatch.setattr(QuietBus, "read", read)
    assert device("--seconds", "0.05") == 0
    assert "clear refused: nothing is latched" in capsys.readouterr().out


def test_a_system_without_that_signal_does_without(quiet: list[QuietBus], monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.delattr(node.signal, "SIGUSR1")
        assert device("--seconds", "0.01") == 0


@pytest.mark.parametrize("ends", [True, False])
def test_only_when_asked_it_ends_with_its_pipe(
    quiet: list[QuietBus], ends: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class AtOnce:
        """A thread that has run before anything else does."""

        def __init__(self, target: Any, args: Any, kwargs: Any, daemon: bool) -> None:
            assert daemon  # or the device would not end while its terminal is open
            self.run = lambda: target(*args, **kwargs)

        def start(self) -> None:
            self.run()

    monkeypatch.setattr(node.threading, "Thread", AtOnce)
    monkeypatch.setattr("sys.stdin", io.StringIO("push 1\nnonsense\n"))
    assert device("--seconds", "0.03", *(["--until-input-ends"] if ends else [])) == 0
    said = capsys.readouterr()
    done = json.loads(said.out.splitlines()[-1].removeprefix("firmware-sim done "))
    assert done["seconds"] == (0.0 if ends else 0.03)
    assert ("nonsense" in said.err) == (not ends)


def test_a_log_that_fills_the_disk_is_one_line_and_2(
    quiet: list[QuietBus], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(self: node.Node, record: dict[str, object]) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(node.Node, "_write", full)
    path = tmp_path / "log"
    assert device("--seconds", "0.01", "--json-log", str(path)) == 2
    said = capsys.readouterr().err
    assert said == (
        f"firmware-sim: {path}: log cannot be written (No space left on device); what it holds so far is kept\n"
    )
    assert quiet[0].closed == 1


@pytest.mark.parametrize("error", [OSError(5, "odd"), KeyError("nobody foresaw this")])
def test_a_defect_is_1_and_leaves_the_bus(
    quiet: list[QuietBus], error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(self: node.Node, seconds: float | None) -> None:
        raise error

    monkeypatch.setattr(node.Node, "run", broken)
    assert device("--seconds", "0.01") == 1
    said = capsys.readouterr().err
    assert said.startswith("firmware-sim: defect: ")
    Path(said.rsplit(" ", 1)[1].strip()).unlink()
    assert quiet[0].closed == 1


def test_what_cannot_start_is_one_line_and_2(quiet: list[QuietBus], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--bus", "can0", "--seconds", "0.01"]) == 2
    said = capsys.readouterr().err
    assert "the demo key is public and refused on a physical bus" in said
    assert said.count("\n") == 1
    assert quiet == []
