"""Small scenarios, rows and log lines that tests of several rooms are made of."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hilbridge.records import Action, HoldReason
from hilbridge.rows import TickRow
from hilscenario import cli
from hilscenario.format.files import scenario_of
from hilscenario.format.schema import Scenario
from hilscenario.live.logs.happened import Happened
from hilscenario.signals.device import DeviceLine, device_line

CATALOG = Path(__file__).parents[2] / "scenarios" / "catalog"
MS = 1_000_000


def scenario(**more: Any) -> Scenario:
    """One second in which nothing happens, with `more` in place of what it has."""
    base = {"name": "live", "duration": "1 s", "expect": [{"figure": "acts", "at_least": 0}]}
    return scenario_of({**base, **more})


def line(at_ms: int, state: str, assist_nm: float, **more: Any) -> DeviceLine:
    """A line of the device's log."""
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


def tick(at_ms: int, action: str) -> TickRow:
    """A tick of an armed bridge."""
    return TickRow(at_ms * MS, Action[action], HoldReason.NONE, 0.9, armed=True, sensing_age_ms=30.0)


def happened(lines: list[DeviceLine] | None = None, ticks: list[TickRow] | None = None) -> Happened:
    """What a live run left: by default a device that follows and a bridge that holds."""
    made = Happened(start_ns=0, device_lines=lines or [line(t_ms, "Follow", 0.0) for t_ms in range(0, 1000, 20)])
    made.bridge_rows = [*(ticks or [tick(0, "HOLD")])]
    return made


def acting(*steps: dict[str, object], duration: str = "3.5 s") -> Scenario:
    """A scripted belief from 0.6 s on that makes the bridge act."""
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


def refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """The one line that `hilscenario run` with these words is refused with."""
    monkeypatch.setattr("sys.argv", ["hilscenario", "run", *words])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error
