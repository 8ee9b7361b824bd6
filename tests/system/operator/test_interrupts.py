"""Ctrl-C at seeded random instants of what runs long: it ends, what it recorded is whole, the device follows.

Two instants of each command by default; `HILBRIDGE_INTERRUPTS=8` gives more than thirty in all.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader

INSTANTS = int(os.environ.get("HILBRIDGE_INTERRUPTS", "2"))
LONGEST_S = 10.0  # from before the imports are over until well into the run
PATIENCE_S = 120.0
QUIET = ("Boot", "SelfTest", "Follow", "Ready")

_SCENARIO = """
name: interrupted
duration: 20 s
seed: 3
intent:
  - {at: 1 s, verb: Pour, confidence: 0.97}
expect:
  - {that: "always device.assist_nm < 3"}
"""


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("video") / "grey.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (160, 120))
    for step in range(50):
        writer.write(np.full((120, 160, 3), step, np.uint8))
    writer.release()
    return path


@contextlib.contextmanager
def device(bus: str, log: Path) -> Iterator[None]:
    """A device of its own, which no Ctrl-C of ours reaches."""
    command = [sys.executable, "-m", "firmware_sim.node", "--bus", bus, "--json-log", str(log)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True) as process:
        assert process.stdout is not None
        assert "ready" in process.stdout.readline()
        try:
            yield
        finally:
            process.terminate()


def last(log: Path) -> dict[str, Any]:
    """The device's newest whole line; empty where it has none."""
    lines = [line for line in log.read_text().splitlines(keepends=True) if line.endswith("}\n")] if log.exists() else []
    found: dict[str, Any] = json.loads(lines[-1]) if lines else {}
    return found


def interrupted(command: list[str], instant_s: float | Callable[[], object], folder: Path) -> str:
    """Run in a session of its own and send Ctrl-C to all of it as a terminal would: after so many seconds, or when a call
    returns. What it said on stderr.
    """
    process = subprocess.Popen(
        [sys.executable, "-m", *command],
        cwd=folder,
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        if callable(instant_s):
            instant_s()
            instant_s = 0.0
        time.sleep(instant_s)
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=PATIENCE_S)
    finally:
        process.kill()
    # Before Python has set its own handler the signal itself ends it: there is nothing to close yet.
    assert process.returncode in (0, 130, -signal.SIGINT), (
        f"{process.returncode} at {instant_s:.3f} s: {errors[-2000:]}"
    )
    assert "defect" not in errors
    # A worker that has only just begun has Python's own word on it, which nobody can keep from the terminal.
    assert "Traceback" not in errors or command[0] == "hilscenario"
    return errors


def assert_closed(folder: Path) -> None:
    """Every recording that was begun is whole: it has its index."""
    for path in folder.rglob("*.mcap"):
        with path.open("rb") as file:
            assert make_reader(file).get_summary() is not None, path


def until(log: Path, state: str) -> None:
    """Wait until the device is in a state."""
    until_s = time.monotonic() + PATIENCE_S
    while last(log).get("state") != state:
        assert time.monotonic() < until_s, last(log)
        time.sleep(0.05)


def instants(command: str) -> list[float]:
    drawn = random.Random(f"{command} 1")
    return [round(drawn.uniform(0.2, LONGEST_S), 3) for _ in range(INSTANTS)]


@pytest.mark.parametrize("instant_s", instants("demo"))
def test_demo(instant_s: float, tmp_path: Path) -> None:
    interrupted(["hilbridge", "demo", "--seconds", "60", "--out", "out", "--json"], instant_s, tmp_path)
    assert_closed(tmp_path)
    newest = last(tmp_path / "out" / "device.jsonl")
    if "state" in newest:
        assert (newest["state"] in QUIET, newest["assist_nm"]) == (True, 0.0), newest


def test_demo_while_it_assists(tmp_path: Path) -> None:
    log = tmp_path / "out" / "device.jsonl"
    interrupted(["hilbridge", "demo", "--seconds", "60", "--out", "out"], lambda: until(log, "Assist"), tmp_path)
    assert_closed(tmp_path)
    assert last(log)["state"] in QUIET


@pytest.mark.parametrize("instant_s", instants("run"))
def test_run(instant_s: float, video: Path, tmp_path: Path) -> None:
    bus = f"hilsim:int-{os.getpid()}-{round(instant_s * 1000)}"
    with device(bus, tmp_path / "device.jsonl"):
        command = ["hilbridge", "run", "--camera", str(video), "--no-hands", "--loop", "--bus", bus, "--out", "out"]
        interrupted(command, instant_s, tmp_path)
        assert_closed(tmp_path)
        until(tmp_path / "device.jsonl", "Follow")


@pytest.mark.parametrize("instant_s", instants("monitor"))
def test_monitor(instant_s: float, tmp_path: Path) -> None:
    bus = f"hilsim:mon-{os.getpid()}-{round(instant_s * 1000)}"
    with device(bus, tmp_path / "device.jsonl"):
        interrupted(["hilbridge", "monitor", "--bus", bus], instant_s, tmp_path)
        until(tmp_path / "device.jsonl", "Follow")


@pytest.mark.parametrize("instant_s", instants("campaign"))
def test_campaign(instant_s: float, tmp_path: Path) -> None:
    (tmp_path / "base.yaml").write_text(_SCENARIO)
    command = ["hilscenario", "campaign", "base.yaml", "--samples", "20", "--out", "out", "--jobs", "2"]
    interrupted(command, instant_s, tmp_path)
    kept = tmp_path / "out" / "campaign.jsonl"
    if kept.exists():
        for line in kept.read_text().splitlines():
            json.loads(line)
