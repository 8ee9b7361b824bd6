"""Commands typed at the device: each does what it says, and what is none is one line."""

from __future__ import annotations

import io
import json
from typing import Any

import pytest

from firmware_sim import node
from firmware_sim.keys import WRONG
from firmware_sim.secoc import DEMO_KEY
from tests.firmware_sim.shared import make


@pytest.mark.parametrize(
    ("command", "reads", "value"),
    [
        ("overrun", "skipped_ms", 10),
        ("overrun 25", "skipped_ms", 25),
        ("stuck", "actuator.stuck", True),
        ("gain 0.5", "actuator.gain", 0.5),
        ("lag 60", "actuator.lag_s", 0.06),
        ("bias -0.25", "actuator.bias_nm", -0.25),
        ("encoder -300", "encoder_offset_mdeg", -300),
        ("push 1.5", "wearer_extra_nm", 1.5),
        ("clear", "local_clear", True),
        ("restart", "state.shared_key", DEMO_KEY),
        ("wrongkey", "state.shared_key", WRONG),
    ],
)
def test_every_command_does_what_it_says(command: str, reads: str, value: object) -> None:
    made, _bus = make()
    made.commands.append(command)
    made._obey()
    found: Any = made.device
    for name in reads.split("."):
        found = getattr(found, name)
    assert found == value


@pytest.mark.parametrize("command", ["overrun x", "encoder 1.5", "gain", "push one", "clearX", "x"])
def test_what_is_no_command_is_one_line_that_lists_them(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    log = io.StringIO()
    made, _bus = make(log)
    made.commands.extend([command, "quit"])
    made._obey()
    said = capsys.readouterr()
    assert said.err.startswith(f"firmware-sim: command {command!r} not understood; clear | overrun [MS] | ")
    assert said.err.count("\n") == 1
    assert [set(json.loads(line)) for line in log.getvalue().splitlines()] == [{"command", "ends_ns"}]
    assert json.loads(log.getvalue())["command"] == "quit"
    assert made.stopping


def test_the_list_of_commands_has_each(capsys: pytest.CaptureFixture[str]) -> None:
    listed = [entry.split()[0] for entry in node._COMMANDS.split("|")]
    assert listed[-1] == "quit"
    arguments = {"gain": " 1", "lag": " 1", "bias": " 0", "encoder": " 0", "push": " 0"}
    for name in listed:
        made, _bus = make()
        made.commands.append(name + arguments.get(name, ""))
        made._obey()
    assert "not understood" not in capsys.readouterr().err
