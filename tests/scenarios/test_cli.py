"""hilscenario as a person calls it: tables, JSON, JUnit, pages, exit codes, one line for bad input."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from typer.testing import CliRunner

from hilscenario import cli
from hilscenario.campaign import base_scenario
from hilscenario.format.files import dump_scenario

CATALOG = Path(__file__).parents[2] / "scenarios" / "catalog"


def call(*arguments: str) -> tuple[int, str]:
    done = CliRunner().invoke(cli.app, list(arguments))
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done.exit_code, done.output


@pytest.fixture
def failing(tmp_path: Path) -> Path:
    path = tmp_path / "failing.yaml"
    scenario = base_scenario()
    path.write_text(dump_scenario(scenario).replace("always device.assist_nm <= 2.001", "always device.assist_zero"))
    return path


def test_run_writes_recording_page_json_and_junit(tmp_path: Path) -> None:
    code, output = call("run", str(CATALOG / "dropout-gaze-off.yaml"), "--out", str(tmp_path), "--jobs", "1")
    assert code == 0
    assert "1 of 1 passed" in output
    (row,) = json.loads((tmp_path / "results.json").read_text())
    assert row["passed"] is True
    suite = ET.parse(tmp_path / "junit.xml").getroot()
    assert (suite.get("tests"), suite.get("failures")) == ("1", "0")
    page = (tmp_path / "gaze-off-while-assisting.html").read_text()
    assert "<svg" in page
    assert "command lost: zero assist within 150 ms" in page
    assert (tmp_path / "gaze-off-while-assisting.mcap").stat().st_size > 1000


def test_a_failure_says_how_to_repeat_it_and_exits_with_1(failing: Path, tmp_path: Path) -> None:
    code, output = call("run", str(failing), "--jobs", "1", "--out", str(tmp_path / "out"))
    assert code == 1
    assert "always device.assist_zero: margin -1" in output
    assert f"repeat: hilscenario run {failing} --seed 11" in " ".join(output.split())
    failure = ET.parse(tmp_path / "out" / "junit.xml").getroot().find(".//failure")
    assert failure is not None
    assert "repeat: hilscenario run" in str(failure.text)


def test_json_is_one_object(failing: Path) -> None:
    code, output = call("run", str(failing), "--jobs", "1", "--json")
    assert code == 1
    assert json.loads(output)["passed"] is False


def test_a_campaign_resumes_where_it_was(tmp_path: Path) -> None:
    base = tmp_path / "base.yaml"
    base.write_text(dump_scenario(base_scenario()))
    words = ["campaign", str(base), "--fault", "bus.cut", "--samples", "1", "--jobs", "1", "--out", str(tmp_path / "c")]
    assert call(*words)[0] == 0
    log = tmp_path / "c" / "campaign.jsonl"
    first = log.read_text().splitlines()
    assert len(first) == 5
    log.write_text("\n".join(first[:3]) + "\n" + first[3][:20])  # cut off within a line
    code, output = call(*words, "--json")
    assert code == 0
    assert json.loads(output)["samples"] == 4
    assert [line for line in log.read_text().splitlines() if line != first[3][:20]] == first


@pytest.mark.timeout(120)
@pytest.mark.parametrize("jobs", ["1", "2"])
def test_ctrl_c_ends_a_campaign_with_one_line_and_keeps_what_it_has(tmp_path: Path, jobs: str) -> None:
    base, log = tmp_path / "base.yaml", tmp_path / "out" / "campaign.jsonl"
    base.write_text(dump_scenario(base_scenario()), encoding="utf-8")
    command = [sys.executable, "-m", "hilscenario.cli", "campaign", str(base), "--out", str(log.parent), "--jobs", jobs]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True) as process:
        while not log.exists() or log.read_text().count("\n") < 2:  # workers that still import would say so
            assert process.poll() is None
            time.sleep(0.1)
        os.killpg(process.pid, signal.SIGINT)
        said = process.communicate(timeout=60)[1]
    assert process.returncode == 130
    assert said.splitlines()[-1] == "hilscenario: interrupted"
    assert "Traceback" not in said


def test_vocabulary_list_and_schema_are_printed() -> None:
    assert "bus.stale_queue" in call("faults")[1]
    assert "seconds" in json.loads(call("list", str(CATALOG), "--json")[1])[0]
    assert json.loads(call("schema")[1])["properties"]["steps"]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("duration: 3 s", "duration: 3 parsec", "is no time"),
        ("device.assist_nm", "device.asist_nm", "no signal `device.asist_nm`; did you mean `device.assist_nm`?"),
        ("verb: Mix", "verb: Mixx", "did you mean `Mix`?"),
    ],
)
def test_bad_files_are_one_line_and_exit_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, old: str, new: str, said: str
) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(dump_scenario(base_scenario()).replace(old, new))
    monkeypatch.setattr("sys.argv", ["hilscenario", "run", str(path), "--jobs", "1"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert error.startswith(f"hilscenario: {path}")
    assert said in error
    assert error.count("\n") == 1
