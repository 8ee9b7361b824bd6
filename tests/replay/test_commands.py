"""Every command that reads recordings: what a crash left is read and told, what is no recording is one line and 2."""

from __future__ import annotations

import json
import random
import zipfile
from pathlib import Path

import pytest
from mcap.writer import Writer

from hilbridge import cli
from hilbridge.guard import guarded
from hilscenario.format.files import scenario_of
from hilscenario.lockstep.run import run_scenario

COMMANDS = {
    "report": ("report", "{}", "--out", "{}.html"),
    "recover": ("recover", "{}", "--out", "{}.whole"),
    "replay": ("replay", "{}"),
    "view": ("view", "{}", "--save", "{}.rrd"),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    plain = {"name": "plain", "duration": "4 s", "seed": 7, "gate": {"tau_on": 0.4, "tau_off": 0.3}}
    run_scenario(scenario_of({**plain, "expect": [{"figure": "trips", "at_most": 9}]}), recording=path)
    return path


def command(name: str, path: Path) -> int:
    if name == "view":
        pytest.importorskip("rerun")
    arguments = [argument.replace("{}", str(path)) for argument in COMMANDS[name]]
    return guarded(lambda: cli.app(arguments, standalone_mode=False), "hilbridge")


@pytest.mark.parametrize("name", COMMANDS)
def test_cut_off_within_its_last_chunks_it_is_read_up_to_there(
    whole: Path, tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    data, chance = whole.read_bytes(), random.Random(4)
    for _ in range(4):
        path = tmp_path / "cut.mcap"
        path.write_bytes(data[: chance.randrange(len(data) * 2 // 3, len(data) - 1)])
        assert command(name, path) == 0
        said = capfd.readouterr().out
        assert name == "view" or "cut off" in " ".join(said.split())


def another(path: Path) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/pose", "json", writer.register_schema("x", "jsonschema", b"{}"))
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()  # type: ignore[no-untyped-call]


def archive(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as made:
        made.writestr("x", "y")


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize(
    "kind", [lambda path: path.write_bytes(b""), lambda path: path.write_bytes(bytes(4096)), another, archive]
)
def test_what_is_no_recording_is_one_line(
    tmp_path: Path, name: str, kind: object, capfd: pytest.CaptureFixture[str]
) -> None:
    assert callable(kind)
    kind(tmp_path / "a.mcap")
    assert command(name, tmp_path / "a.mcap") == 2
    said = capfd.readouterr()
    assert said.out == ""
    assert len(said.err.strip().splitlines()) == 1
    assert "a.mcap" in said.err
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


def test_replay_says_by_its_exit_code_whether_decisions_differ(
    whole: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    def replay(*more: str) -> int:
        return guarded(lambda: cli.app(["replay", str(whole), *more], standalone_mode=False), "hilbridge")

    assert replay("--json") == 0
    same = json.loads(capfd.readouterr().out)
    assert same["bit_equal"]
    assert same["ticks_differing"] == 0
    assert replay("--json", "--what-if", "gate.tau_on=0.99", "--out", str(tmp_path / "page.html")) == 1
    other = json.loads(capfd.readouterr().out)
    assert other["ticks_differing"] > 0
    assert other["what_if"] == ["gate.tau_on=0.99"]
    assert "<svg" in (tmp_path / "page.html").read_text()
    assert replay("--from", "memory") == 2
    assert "there are features, gaze+video, beliefs" in capfd.readouterr().err
