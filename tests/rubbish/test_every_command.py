"""Every command and twenty kinds of rubbish: one line, exit code 2 (or 1 for a verdict), never a traceback.

In this process, since what is tested is what leaves `guarded`; a sample goes through the real programs.
"""

from __future__ import annotations

import os
import random
import resource
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import typer

from firmware_sim import node
from hilbridge import cli
from hilbridge.guard import guarded
from hilbridge.wire.dbc import default_dbc_path
from hilscenario import cli as scenario_cli
from hilscenario.format.files import load_scenario
from hilscenario.lockstep.run import run_scenario
from tests.labels.made import recording as labelled_recording
from tests.scenarios.made import CATALOG

RUBBISH: dict[str, Callable[[Path], object]] = {
    "absent": lambda path: None,
    "empty": lambda path: path.write_bytes(b""),
    "folder": lambda path: path.mkdir(),
    "one byte": lambda path: path.write_bytes(b"\x00"),
    "noise": lambda path: path.write_bytes(random.Random(1).randbytes(4096)),
    "text": lambda path: path.write_text("not what you think\n" * 50),
    "latin-1": lambda path: path.write_bytes("Gr\xfc\xdfe: \xe9t\xe9\n".encode("latin-1") * 20),
    "utf-16": lambda path: path.write_text("a: 1\n" * 20, encoding="utf-16"),
    "bom": lambda path: path.write_bytes(b"\xef\xbb\xbf"),
    "nul bytes": lambda path: path.write_bytes(b"a\x00b\x00c\n" * 50),
    "one long line": lambda path: path.write_text("x" * 200_000),
    "deep": lambda path: path.write_text("[" * 20_000),
    "json list": lambda path: path.write_text("[1, 2, 3]"),
    "json null": lambda path: path.write_text("null"),
    "yaml map": lambda path: path.write_text("name: x\nsteps: 7\nduration: [1]\n"),
    "yaml alias": lambda path: path.write_text("a: &a [*a]\nb: *a\n"),
    "toml": lambda path: path.write_text("[sensors]\ncamera = 3.5\n[bus]\nspec = []\n"),
    "csv": lambda path: path.write_text("time_s,x,y\nnan,inf,-\n1e999,,\n"),
    "cut magic": lambda path: path.write_bytes(b"\x89MCAP0\r\n\x01\xff\xff\xff\xff\xff\xff\xff\x7f"),
    "huge length": lambda path: path.write_bytes(b"\xff" * 8 + b"{}" * 20),
}
LOGS = ("blf", "asc", "mf4", "log", "trc", "csv", "parquet")
COMMANDS: dict[str, tuple[typer.Typer, tuple[str, ...]]] = {
    "report": (cli.app, ("report", "{}")),
    "recover": (cli.app, ("recover", "{}")),
    "replay": (cli.app, ("replay", "{}")),
    "view": (cli.app, ("view", "{}", "--save", "{}.rrd")),
    "bus-analysis": (cli.app, ("bus-analysis", "{}")),
    "run camera": (cli.app, ("run", "--no-hands", "--seconds", "0.1", "--bus", "hilsim:rub", "--camera", "{}")),
    "run config": (cli.app, ("run", "--config", "{}")),
    "run key": (cli.app, ("run", "--camera", "{}", "--no-hands", "--key-file", "{}")),
    "run bundle": (cli.app, ("run", "--camera", "0", "--no-hands", "--bundle", "{}")),
    "run gaze": (cli.app, ("run", "--camera", "0", "--no-hands", "--gaze", "{}")),
    "certify": (cli.app, ("certify", "--people", "2", "--bundle", "{}")),
    "data describe": (cli.app, ("data", "describe", "{}")),
    "data pack": (cli.app, ("data", "pack", "{}")),
    "label": (cli.app, ("label", "{}", "--export", "{}.csv")),
    "label import": (cli.app, ("label", "{good}", "--import", "{}")),
    "label eaf": (cli.app, ("label", "{good}", "--import", "{}.eaf")),
    "forget": (cli.app, ("forget", "P-07", "{}")),
    "export": (cli.app, ("export", "{}", "--to", "asc", "--out", "{}.asc")),
    "export to": (cli.app, ("export", "{good}", "--to", "{}")),
    "import": (cli.app, ("import", "{}", "{}.mcap")),
    **{f"import {kind}": (cli.app, ("import", f"{{}}.{kind}", "{}.mcap")) for kind in LOGS},
    "play": (cli.app, ("play", "{}", "--bus", "hilsim:rub")),
    "demo": (cli.app, ("demo", "--seconds", "3", "--out", "{}")),
    "demo bus": (cli.app, ("demo", "--seconds", "3", "--bus", "{}")),
    "bench": (cli.app, ("bench", "{}")),
    "fetch-models": (cli.app, ("fetch-models", "{}")),
    "dbc": (cli.app, ("dbc", "--out", "{}/ours.dbc")),
    "candump": (cli.app, ("candump", "--seconds", "0.1", "--bus", "{}")),
    "docs": (cli.app, ("docs", "{}")),
    "train": (cli.app, ("train", "--people", "8", "--seconds", "10", "--out", "{}/b", "--work", "{}/work")),
    "certify write": (cli.app, ("certify", "--people", "2", "--bundle", "{}", "--write", "{}")),
    "evaluate": (cli.app, ("evaluate", "--data", "{}", "--out", "{}.out")),
    "scenario run": (scenario_cli.app, ("run", "{}", "--jobs", "1")),
    "scenario list": (scenario_cli.app, ("list", "{}")),
    "scenario campaign": (scenario_cli.app, ("campaign", "{}", "--jobs", "1", "--out", "{}.out")),
    "scenario minimise": (scenario_cli.app, ("minimise", "{}")),
    "scenario out": (scenario_cli.app, ("run", "catalog/dropout-gaze-off.yaml", "--jobs", "1", "--out", "{}")),
    "scenario figures": (scenario_cli.app, ("figures", "{}")),
    "scenario faults": (scenario_cli.app, ("faults", "{}")),
    "scenario schema": (scenario_cli.app, ("schema", "{}")),
}
# What a command rightly takes: a folder, or a name that is free.
TAKES = {"forget": ("folder",)} | dict.fromkeys(("demo", "train", "dbc", "scenario out"), ("absent", "folder"))
WORDS: list[tuple[typer.Typer, tuple[str, ...]]] = [
    (cli.app, ("nonsense",)),
    (cli.app, ("demo", "--seconds", "nan")),
    (cli.app, ("demo", "--seconds", "soon")),
    (cli.app, ("demo", "--bus", ":")),
    (cli.app, ("demo", "--bus", "hilsim:" + "x" * 100)),
    (cli.app, ("demo", "--out", "/proc/nowhere/x")),
    (cli.app, ("demo", "--out", "/dev/null")),
    (cli.app, ("run", "--out", "/dev/null/x", "--camera", "0")),
    (cli.app, ("run", "--camera", "999999999999999999999", "--no-hands")),
    (cli.app, ("candump", "--bus", "kvaser:0")),
    (cli.app, ("candump", "--bus", "socketcand:x")),
    (cli.app, ("candump", "--bus", "udp_multicast:239.74.163.2")),
    (cli.app, ("candump", "--bus", "no_such_interface:x")),
    (cli.app, ("dbc", "--out", "/proc/nowhere.dbc")),
    (cli.app, ("docs", "../../etc/passwd")),
    (cli.app, ("bus-analysis", "{}", "--bitrate", "0")),
    (cli.app, ("certify", "--method", "guess")),
    (cli.app, ("train", "--wearer", "nobody")),
    (scenario_cli.app, ("run",)),
    (scenario_cli.app, ("run", "catalog/no-such.yaml")),
    (scenario_cli.app, ("run", "catalog", "--bus", "vcan0")),
    (scenario_cli.app, ("run", "catalog", "--live", "--bus", "can0")),
    (scenario_cli.app, ("campaign", "catalog", "--fault", "no.such")),
    (scenario_cli.app, ("run", "catalog/an-ordinary-minute.yaml", "--out", "/proc/nowhere")),
]


def one_line(app: typer.Typer, arguments: tuple[str, ...], capfd: pytest.CaptureFixture[str]) -> str:
    name = "hilbridge" if app is cli.app else "hilscenario"
    before = signal.getsignal(signal.SIGINT)
    try:
        code = guarded(lambda: app(list(arguments), standalone_mode=False, prog_name=name), name)
    finally:
        signal.signal(signal.SIGINT, before)
    said = capfd.readouterr().err
    assert code in (1, 2), f"{arguments}: exit code {code}, {said}"
    lines = said.strip().splitlines()
    assert "Traceback" not in said
    assert len(lines) == 1, f"{arguments}: {said}"
    assert "defect" not in said, f"{arguments}: {said}"
    return lines[0]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("command", COMMANDS)
def test_rubbish_is_one_line(command: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    app, words = COMMANDS[command]
    good = labelled_recording(tmp_path / "good.mcap") if any("{good}" in word for word in words) else tmp_path
    for kind, make in RUBBISH.items():
        path = tmp_path / f"{kind.replace(' ', '-')}.yaml"
        make(path)
        for word in words:
            if word.startswith("{}.") and word != "{}.out":  # the same rubbish under a name that says what it should be
                make(Path(word.replace("{}", str(path))))
        if kind in TAKES.get(command, ()):
            continue
        filled = (word.replace("{}", str(path)).replace("{good}", str(good)) for word in words)
        one_line(app, tuple(filled), capfd)


def test_the_doctor_calls_rubbish_ill(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for kind, make in RUBBISH.items():
        path = tmp_path / kind
        make(path)
        words = [
            "doctor",
            *(word for option in ("bus", "bundle", "camera", "gaze") for word in (f"--{option}", str(path))),
        ]
        code = guarded(lambda: cli.app(words, standalone_mode=False), "hilbridge")  # noqa: B023 - called at once
        said = capfd.readouterr()
        assert code == 1, f"{kind}: {said}"
        assert said.err == ""
        for part in ("bus", "bundle", "camera", "gaze"):
            assert any(line.startswith("ill") and f" {part} " in line for line in said.out.splitlines()), (
                f"{kind}: {part}"
            )


@pytest.mark.parametrize(("app", "arguments"), WORDS, ids=lambda value: " ".join(value) if type(value) is tuple else "")
def test_nonsense_is_one_line(
    app: typer.Typer, arguments: tuple[str, ...], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    one_line(app, tuple(word.replace("{}", str(tmp_path / "absent")) for word in arguments), capfd)


@pytest.mark.parametrize(
    "arguments",
    [
        ["--bus", "kvaser:0"],
        ["--bus", "socketcand:x"],
        ["--bus", ":"],
        ["--bus", "virtual:x", "--key-file", "/dev/null"],
        ["--bus", "virtual:x", "--json-log", "/proc/nowhere/log"],
        ["--seconds", "nan"],
        ["--log-ms", "0"],
        ["--nonsense"],
    ],
)
def test_the_device_says_one_line_too(arguments: list[str], capfd: pytest.CaptureFixture[str]) -> None:
    try:
        code = node.main(arguments)
    except SystemExit as ended:  # argparse leaves by itself
        code = ended.code if isinstance(ended.code, int) else 1
    said = capfd.readouterr().err
    assert code == 2
    assert len(said.strip().splitlines()) == 1, said
    assert "Traceback" not in said


def _small_files() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (512, resource.RLIM_INFINITY))


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "recording.mcap"
    scenario = load_scenario(CATALOG / "dropout-gaze-off.yaml")
    run_scenario(scenario, recording=path)
    return path


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("hilbridge.cli", ["dbc", "--out", "{out}/x"]),
        ("hilbridge.cli", ["report", "{recording}", "--out", "{out}/x.html"]),
        ("hilbridge.cli", ["recover", "{recording}", "--out", "{out}/x.mcap"]),
        ("hilbridge.cli", ["demo", "--seconds", "3", "--bus", "hilsim:full", "--out", "{out}"]),
        ("hilbridge.cli", ["train", "--people", "8", "--seconds", "10", "--out", "{out}/b", "--work", "{out}"]),
        ("hilscenario.cli", ["run", "catalog/dropout-gaze-off.yaml", "--jobs", "1", "--out", "{out}"]),
    ],
    ids=lambda value: value[0] if type(value) is list else "",
)
def test_a_full_disk_is_one_line_that_names_the_file(
    program: str, words: list[str], recording: Path, tmp_path: Path
) -> None:
    """No file may grow beyond 512 bytes: the same error path as that of a disk without space."""
    filled = [word.format(out=tmp_path / "full", recording=recording) for word in words]
    command = [sys.executable, "-m", program, *filled]
    done = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=_small_files)
    assert done.returncode == 2, done.stderr
    said = done.stderr.strip().splitlines()[-1]
    assert "Traceback" not in done.stderr
    assert "defect" not in done.stderr
    assert str(tmp_path / "full") in said, said
    assert "large" in said


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("hilbridge.cli", ["dbc"]),
        ("hilbridge.cli", ["docs"]),
        ("hilbridge.cli", ["--help"]),
        ("hilbridge.cli", ["bus-analysis", str(default_dbc_path())]),
        ("hilbridge.cli", ["doctor", "--bus", "hilsim:closed"]),
        ("hilscenario.cli", ["list", "catalog"]),
        ("hilscenario.cli", ["figures"]),
        ("hilscenario.cli", ["faults"]),
        ("hilscenario.cli", ["schema"]),
    ],
)
def test_a_closed_or_full_output_is_one_line(program: str, words: list[str]) -> None:
    command = [sys.executable, "-m", program, *words]
    with open("/dev/full", "w") as full:  # noqa: PTH123
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert "space" in done.stderr
    reading, writing = os.pipe()
    os.close(reading)  # before the program begins: one that is quick would have written all of it by then
    closed = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert closed.returncode == 1
    assert len(closed.stderr.strip().splitlines()) == 1, closed.stderr
