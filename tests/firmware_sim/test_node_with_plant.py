"""The node of a device whose arm is on a plant bus: which bus it takes, and what it cannot be told."""

from __future__ import annotations

import io
import json
import runpy
import sys
from importlib.metadata import version
from typing import Any

import pytest

from firmware_sim import node
from firmware_sim.bench.link import LinkedDevice
from firmware_sim.bench.remote import RemoteDevice
from firmware_sim.controllers import power_on
from firmware_sim.secoc import DEMO_KEY
from tests.firmware_sim.shared import make


@pytest.mark.parametrize("command", ["stuck", "gain 0.5", "lag 60", "bias 1", "mend", "encoder 3", "push 1"])
def test_arm_and_motor_are_the_plants(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    made, _bus = make()
    made.device = RemoteDevice(power_on("python", DEMO_KEY, 1))
    made.commands.append(command)
    made._obey()
    assert capsys.readouterr().err.startswith(f"firmware-sim: command {command!r} not understood; ")


def test_main_takes_the_plant_bus(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A plant that never speaks: what the device reads is not to be trusted, so it does not even follow."""
    monkeypatch.setattr("sys.stdin", io.StringIO())
    made: list[Any] = []
    monkeypatch.setattr(node, "_on_signals", made.append)
    words = ["--bus", "virtual:with-plant", "--plant-bus", "virtual:its-plant", "--seconds", "0.1"]
    assert node.main(words) == 0
    assert isinstance(made[0].device, LinkedDevice)
    done = json.loads(capsys.readouterr().out.splitlines()[1].removeprefix("firmware-sim done "))
    assert done["state"] != "Follow"


def test_the_version_is_the_packages(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        node.main(["--version"])
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"firmware-sim {version('hilbridge')}\n"
    with pytest.raises(SystemExit, match="0"):
        node.main(["--help"])
    assert "[--version]" in capsys.readouterr().out


def test_the_file_itself_is_the_program(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["firmware-sim", "--version"])
    with pytest.raises(SystemExit, match="0"):
        runpy.run_path(node.__file__, run_name="__main__")
    assert capsys.readouterr().out.startswith("firmware-sim ")
