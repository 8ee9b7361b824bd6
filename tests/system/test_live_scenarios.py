"""Scenarios live on the simulated bus: real processes and the real clock, faults of every kind, nothing left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from firmware_sim.attachment import Attachment
from firmware_sim.attachment import parse_spec as device_spec
from hilbridge.bus.port.spec import BusSpec, parse_spec
from hilbridge.errors import InputError
from hilbridge.observe.reading import read_recording
from hilbridge.records import Action
from hilbridge.rows import TickRow
from hilscenario.format.files import dump_scenario, scenario_of
from hilscenario.format.schema import Scenario, Session
from hilscenario.live.run import run_live
from tests.scenarios.sessions import film

pytestmark = pytest.mark.timeout(300)


def bus(name: str) -> BusSpec:
    return parse_spec(f"hilsim:live-{name}-{os.getpid()}")


def acting(*steps: dict[str, Any], seconds: float = 4.0) -> Scenario:
    return scenario_of(
        {
            "name": "live",
            "duration": f"{seconds} s",
            "intent": [{"at": "0.5 s", "verb": "Pour", "confidence": 0.97}],
            "gate": {"alpha": 0.6},
            "steps": list(steps),
            "expect": [{"figure": "acts", "at_least": 1}],
        }
    )


def when_it_assists(fault: str, after_ms: int, for_ms: int | None, **options: float) -> dict[str, Any]:
    step: dict[str, Any] = {"fault": fault, "when": "device.assist_nm != 0", "after": f"{after_ms} ms", "with": options}
    return step if for_ms is None else {**step, "for": f"{for_ms} ms"}


@pytest.mark.parametrize(
    "steps",
    [
        pytest.param(
            [
                when_it_assists("hands.stuck", 100, 200),
                when_it_assists("wearer.opposing", 100, 300, torque_nm=0.5),
                when_it_assists("gaze.off", 400, 400),
                when_it_assists("camera.delayed", 1300, 300, delay_ms=60),
            ],
            id="sensors and wearer",
        ),
        pytest.param(
            [
                when_it_assists("bus.duplicate", 100, 200),
                when_it_assists("bus.corrupt", 400, 200, share=0.2),
                when_it_assists("bus.cut", 800, 300),
                when_it_assists("bus.stale_queue", 1600, 300),
                when_it_assists("bus.stop", 2300, None),
            ],
            id="bus",
        ),
        pytest.param(
            [
                when_it_assists("device.actuator_lag", 100, 200, time_constant_ms=5),
                when_it_assists("bridge.hang", 400, 300),
                when_it_assists("bridge.restart", 1200, None, down_ms=200),
            ],
            id="processes and device",
        ),
    ],
)
def test_faults_live_take_effect_and_the_device_stays_safe(
    steps: list[dict[str, Any]], tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    name = request.node.callspec.id.split()[0]
    run = run_live(acting(*steps), bus(name), recording=tmp_path / "run.mcap")
    assert run.result.live
    assert [fault.fault for fault in run.result.faults if not fault.worked] == []
    assert [judgement.name for judgement in run.result.judgements if not judgement.holds] == []
    topics = {row.topic for row in read_recording(tmp_path / "run.mcap")}
    assert {"/meta", "/tick", "/can", "/device", "/event", "/counters"} <= topics


def test_a_bridge_that_is_started_again_finds_the_faults_that_are_still_under_way(tmp_path: Path) -> None:
    gaze = {"fault": "gaze.off", "at": "1 s", "for": "2 s"}
    restart = {"fault": "bridge.restart", "at": "1.5 s", "with": {"down_ms": 100}}
    scenario = acting(gaze, restart, seconds=5.0)
    run = run_live(scenario, bus("again"), recording=tmp_path / "run.mcap")
    assert all(fault.worked for fault in run.result.faults)
    ticks = [row for row in read_recording(tmp_path / "run.mcap") if isinstance(row, TickRow)]
    rows = [(row.time_ns / 1e9, row) for row in ticks]
    between = [row for at_s, row in rows if 1.5 < at_s < 2.9]
    assert len(between) > 5  # another process ticks
    assert {row.action for row in between} == {Action.HOLD}
    assert all(row.sensor_problem for row in between)
    assert any(row.action is Action.ACT for at_s, row in rows if at_s > 3.0)


def test_a_film_stands_before_live_sensors(tmp_path: Path) -> None:
    scenario = acting().model_copy(update={"intent": Session.model_validate(film(tmp_path))})
    run = run_live(scenario, bus("film"))
    seen = [row.valid for row in run.ticks[10:]]
    assert seen.count((True, False, True)) > 0.7 * len(seen)  # gaze and scene; no hands, none were looked for
    assert any(row.top_confidence for row in run.ticks)
    assert [judgement.name for judgement in run.result.judgements if judgement.safety and not judgement.holds] == []


def test_a_bus_with_somebody_on_it_is_refused() -> None:
    spec = bus("taken")
    listener = Attachment(device_spec(str(spec)))  # acknowledges
    device = [sys.executable, "-m", "firmware_sim.node", "--bus", str(spec)]
    chatter = subprocess.Popen(device, stdout=subprocess.PIPE, text=True)
    try:
        assert chatter.stdout is not None
        assert "ready" in chatter.stdout.readline()
        with pytest.raises(InputError, match="somebody is on it already"):
            run_live(acting(), spec)
    finally:
        chatter.kill()
        chatter.communicate()
        listener.close()


def in_session(session: int) -> list[tuple[str, str]]:
    """(state, command line) of every process of a session that has not ended."""
    found = []
    for folder in Path("/proc").iterdir():
        try:
            if folder.name.isdigit() and os.getsid(int(folder.name)) == session:
                state = (folder / "stat").read_text().rpartition(")")[2].split()[0]
                found.append((state, (folder / "cmdline").read_text().replace("\0", " ")))
        except (OSError, ValueError):  # it has ended meanwhile
            continue
    return [(state, command) for state, command in found if state != "Z"]


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
@pytest.mark.parametrize("end", ["Ctrl-C", "SIGKILL"])
def test_nothing_is_left_behind_however_it_ends(end: str, tmp_path: Path) -> None:
    path = tmp_path / "long.yaml"
    hang: dict[str, Any] = {"fault": "bridge.hang", "at": "500 ms", "for": "100 s"}
    path.write_text(dump_scenario(acting(hang, seconds=120.0)))
    command = [sys.executable, "-m", "hilscenario.cli", "run", str(path), "--live", "--bus", str(bus(end)), "--json"]
    process = subprocess.Popen(
        command, start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    until_s = time.monotonic() + 120.0
    while not any(state == "T" for state, _ in in_session(process.pid)):  # a bridge that hangs is the hardest to end
        assert time.monotonic() < until_s, in_session(process.pid)
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
    if end == "Ctrl-C":
        os.killpg(process.pid, signal.SIGINT)
    else:
        process.send_signal(getattr(signal, end))
    _, errors = process.communicate(timeout=60.0)
    if end == "Ctrl-C":
        assert process.returncode == 130
        assert "Traceback" not in errors
    while in_session(process.pid) and time.monotonic() < until_s:
        time.sleep(0.05)
    assert in_session(process.pid) == []
