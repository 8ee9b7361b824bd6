"""Every small example does what it says, from another folder; none is longer than a page."""

from __future__ import annotations

import math
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import can
import pytest

from hilbridge.observe.reading import read_recording
from hilbridge.rows import GazeRow, HandsRow
from hilscenario.format.files import load_scenario
from hilscenario.lockstep.run import run_scenario
from tests.scenarios.made import CATALOG
from tests.scenarios.sessions import film

EXAMPLES = Path(__file__).parents[2] / "examples"
LONGEST = 40
A_WHOLE_DEVICE = "second_device.py"


def run(name: str, *arguments: str, cwd: Path) -> str:
    command = [sys.executable, str(EXAMPLES / name), *arguments]
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recorded") / "recording.mcap"
    run_scenario(load_scenario(CATALOG / "bus-cut.yaml"), recording=path)
    return path


def test_none_is_longer_than_a_page() -> None:
    lines = {path.name: len(path.read_text().splitlines()) for path in EXAMPLES.glob("*.py")}
    assert {name for name, count in lines.items() if count > LONGEST} == {A_WHOLE_DEVICE}


def test_the_core_is_stepped(tmp_path: Path) -> None:
    said = run("step_the_core.py", cwd=tmp_path)
    assert "ACT Take" in said
    assert "HOLD warming_up" in said


def test_a_recording_is_read(recording: Path, tmp_path: Path) -> None:
    said = run("read_a_recording.py", str(recording), cwd=tmp_path)
    assert " /tick" in said
    assert "ticks of ACT, mean confidence 0.9" in said


def test_thresholds_are_tried_on_a_recording(recording: Path, tmp_path: Path) -> None:
    said = run("what_if.py", str(recording), "0.6", "0.99", cwd=tmp_path).splitlines()
    assert said[0].startswith("tau_on 0.6: ")
    assert said[1].split()[2] != "0"


def test_scenarios_are_run(tmp_path: Path) -> None:
    said = run("run_scenarios.py", cwd=tmp_path).splitlines()
    assert [line.split()[0] for line in said] == ["ok"] * 3


def test_a_bus_is_watched(tmp_path: Path) -> None:
    end = threading.Event()
    with can.Bus(interface="hilsim", channel="watched") as bus:
        stop = can.Message(arbitration_id=1, data=b"", is_extended_id=False)

        def speak() -> None:
            while not end.wait(0.02):
                with suppress(can.CanError):  # until the watcher is there nobody acknowledges
                    bus.send(stop)

        speaker = threading.Thread(target=speak)
        speaker.start()
        try:
            assert run("watch_the_bus.py", "hilsim:watched", "3", cwd=tmp_path).startswith("STOP {}")
        finally:
            end.set()
            speaker.join()


def test_sensors_of_ones_own_are_read(tmp_path: Path) -> None:
    film(tmp_path)
    (tmp_path / "own.toml").write_text('[sensors]\nhand_detector = "own_sensors:Detector"\n')
    words = ["--camera", str(tmp_path / "session.avi"), "--gaze", "own_sensors:Tracker:0.3"]
    words += ["--config", str(tmp_path / "own.toml"), "--bus", "hilsim:own", "--seconds", "3", "--out", str(tmp_path)]
    command = [sys.executable, "-m", "hilbridge", "run", *words, "--json"]
    done = subprocess.run(command, cwd=EXAMPLES, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    rows = list(read_recording(tmp_path / "recording.mcap"))
    looks = [row for row in rows if isinstance(row, GazeRow)]
    assert looks
    assert all(abs(math.hypot(row.x - 0.5, row.y - 0.5) - 0.3) < 1e-6 for row in looks if row.x and row.y)
    assert {row.count for row in rows if isinstance(row, HandsRow)} == {1}
