"""`hilscenario benefit` as a person calls it."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from typer.testing import CliRunner

from hilscenario import cli
from hilscenario.benefit.gates import Gate
from hilscenario.benefit.measured import PEAKS, SUMS
from hilscenario.benefit.run import OFF, Outcome
from hilscenario.benefit.visits import Visit


def _made(
    visits: Sequence[Visit], compared: Sequence[Gate], jobs: int, progress: Callable[[str], None], log: Path | None
) -> list[Outcome]:
    del log
    progress("one")
    sums = dict.fromkeys((*SUMS, *PEAKS), 1.0)
    return [Outcome(name, visit, sums) for visit in visits for name in (OFF, *(gate.name for gate in compared))]


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hilscenario.benefit.run.compare", _made)


def test_tables_and_files(tmp_path: Path) -> None:
    done = CliRunner().invoke(cli.app, ["benefit", "--people", "2", "--raw-tau", "0.6", "--out", str(tmp_path)])
    assert done.exit_code == 0
    assert "uncalibrated 0.6" in done.output
    assert {"benefit.json", "benefit.png"} == {path.name for path in tmp_path.iterdir()}


def test_json() -> None:
    done = CliRunner().invoke(cli.app, ["benefit", "--people", "2", "--sessions", "1", "--json"])
    assert json.loads(done.stdout)["figures"]["all"]["sessions"] == 2


def test_one_person_has_no_interval() -> None:
    assert CliRunner().invoke(cli.app, ["benefit", "--people", "1"]).exit_code == 2
