"""`hilbridge conformance` and `hilbridge plant` as a lab runs them: programs on simulated buses, in real time."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from firmware_sim.c import binding

BINARIES = Path(sys.executable).parent
STARTS_S = 60.0
# Those that need no even frames: a busy computer can only make them slow.
CLAIMS = ("version", "arming", "neutral-first", "act-other-session", "response-once", "acts", "e2e-length", "mac-forged",
          "three-macs", "latch-stays", "reset", "stop-in-follow")  # fmt: skip


@contextmanager
def program(log: Path, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    """A program that says `ready`, for as long as this lasts."""
    with log.open("wb") as said:
        process = subprocess.Popen([sys.executable, "-m", *words], stdin=subprocess.DEVNULL, stdout=said, stderr=said)
    try:
        end_s = time.monotonic() + STARTS_S
        while b" ready on" not in log.read_bytes():
            assert process.poll() is None, log.read_text()
            assert time.monotonic() < end_s, "it does not start"
            time.sleep(0.05)
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(20.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def conformance(bus: str, *words: str) -> subprocess.CompletedProcess[str]:
    command = [str(BINARIES / "hilbridge"), "conformance", "--bus", bus, *words]
    return subprocess.run(command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)


@pytest.mark.timeout(400)
@pytest.mark.parametrize("controller", ["python", "c"])
def test_a_simulated_device_keeps_its_claims(controller: str, tmp_path: Path) -> None:
    if controller == "c" and not binding.available():
        pytest.skip(f"the C controller is {binding.why_not()}")
    bus, junit = f"hilsim:conformance-{controller}-{os.getpid()}", tmp_path / "junit.xml"
    words = ("firmware_sim.node", "--bus", bus, "--controller", controller, "--wearer-torque", "sway")
    with program(tmp_path / "device.out", *words) as device:
        only = [word for claim in CLAIMS for word in ("--only", claim)]
        ended = conformance(bus, *only, "--clear-command", f"kill -USR1 {device.pid}", "--junit", str(junit), "--json")
    told = json.loads(ended.stdout)
    assert [one for one in told["findings"] if one["verdict"] != "kept"] == []
    assert (ended.returncode, told["passed"]) == (0, True)
    assert ET.parse(junit).getroot().get("tests") == str(len(CLAIMS))


@pytest.mark.timeout(120)
def test_a_bus_without_a_device_is_one_line_with_the_cure() -> None:
    ended = conformance(f"hilsim:nobody-{os.getpid()}")
    assert ended.returncode == 2
    assert ended.stdout == ""
    assert ended.stderr.count("\n") == 1
    assert "no device is heard in 1.5 s; switch it on" in ended.stderr


@pytest.mark.timeout(120)
def test_a_physical_bus_asks_for_a_bench_before_anything_is_sent() -> None:
    ended = conformance("slcan:socket://127.0.0.1:9")
    assert ended.returncode == 2
    assert ended.stderr.count("\n") == 1


@pytest.mark.timeout(400)
def test_a_device_follows_on_an_arm_on_another_bus(tmp_path: Path) -> None:
    bus, arm = f"hilsim:planted-{os.getpid()}", f"hilsim:arm-{os.getpid()}"
    with program(tmp_path / "plant.out", "firmware_sim.bench.process", "--bus", arm, "--wearer-torque", "sway"):
        words = ("firmware_sim.node", "--bus", bus, "--plant-bus", arm)
        with program(tmp_path / "device.out", *words) as device:
            ended = conformance(bus, "--only", "acts", "--clear-command", f"kill -USR1 {device.pid}", "--json")
    finding = json.loads(ended.stdout)["findings"][0]
    assert (finding["name"], finding["verdict"]) == ("acts", "kept"), finding
    account = json.loads((tmp_path / "plant.out").read_text().rpartition("plant done ")[2])
    assert account["answers"] > 1000
    assert account["repeated"] == 0
    assert account["peak_unm"] > 0


@pytest.mark.timeout(120)
def test_a_plant_has_its_bus_to_itself(tmp_path: Path) -> None:
    bus = f"hilsim:shared-{os.getpid()}"
    with program(tmp_path / "device.out", "firmware_sim.node", "--bus", bus):
        command = [str(BINARIES / "hilbridge"), "plant", "--bus", bus, "--seconds", "1"]
        ended = subprocess.run(command, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    assert ended.returncode == 2
    assert (
        "no frame of dbc/plant.dbc; give the plant a bus of its own" in ended.stderr
        or "cannot be opened" in ended.stderr
    )
