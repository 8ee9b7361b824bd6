"""kill -9 of whoever started processes: two seconds later none of them is left, and the next run works."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
PATIENCE_S = 120.0
GONE_S = 2.0
SCENARIO = """
name: orphans
seed: 1
duration: 60 s
intent: [{at: 0.6 s, verb: Pour, confidence: 0.97}]
expect: [{that: always device.assist_nm <= 2.001}]
"""


def marked(mark: str) -> set[int]:
    """Processes whose environment holds the mark: children inherit it, however they are started."""
    found = set()
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            alive = (folder / "stat").read_text().rsplit(")", 1)[1].split()[0] not in "ZX"
            if alive and f"ORPHANS={mark}".encode() in (folder / "environ").read_bytes():
                found.add(int(folder.name))
        except OSError:
            continue
    return found


def await_count(mark: str, count: int) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while len(marked(mark)) < count:
        assert time.monotonic() < end_s, f"{marked(mark)} of {count} processes"
        time.sleep(0.2)


@pytest.mark.parametrize(
    ("program", "words", "processes"),
    [
        ("hilbridge.cli", ["demo", "--seconds", "60", "--bus", "hilsim:{mark}", "--out", "{folder}"], 3),
        ("firmware_sim.node", ["--bus", "hilsim:{mark}"], 2),
        ("hilscenario.cli", ["run", "{scenario}", "--live", "--bus", "hilsim:{mark}"], 5),
        ("hilbridge.cli", ["bench"], 3),
        ("hilbridge.cli", ["evaluate", "--out", "{folder}"], 3),
        ("hilscenario.cli", ["campaign", "{base}", "--jobs", "2", "--out", "{folder}"], 3),
    ],
    ids=["demo", "firmware-sim", "live scenario", "bench", "evaluate", "campaign"],
)
def test_nobody_is_left(program: str, words: list[str], processes: int, tmp_path: Path) -> None:
    from hilscenario.campaign import base_scenario
    from hilscenario.format.files import dump_scenario

    mark = f"orphans-{os.getpid()}-{processes}-{words[0].strip('-')}"
    (tmp_path / "scenario.yaml").write_text(SCENARIO)
    (tmp_path / "base.yaml").write_text(dump_scenario(base_scenario()))
    names = {"mark": mark, "folder": tmp_path / "out", "scenario": tmp_path / "scenario.yaml"}
    filled = [word.format(**names, base=tmp_path / "base.yaml") for word in words]
    process = subprocess.Popen(
        [sys.executable, "-m", program, *filled],
        env={**os.environ, "ORPHANS": mark},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        stdin=subprocess.DEVNULL,
    )
    try:
        await_count(mark, processes)
        time.sleep(1.0)  # workers take up their lease with their first task
        process.kill()
        process.wait()
        end_s = time.monotonic() + GONE_S
        while (left := marked(mark)) and time.monotonic() < end_s:
            time.sleep(0.1)
        assert not left, [Path(f"/proc/{pid}/cmdline").read_bytes() for pid in left]
    finally:
        process.kill()
        for pid in marked(mark):
            os.kill(pid, signal.SIGKILL)


def test_a_device_in_the_background_of_a_terminal_runs_to_its_end(tmp_path: Path) -> None:
    """The system stops a background job that reads its terminal: this one must not."""
    import pty
    import termios

    ours, theirs = pty.openpty()
    log = tmp_path / "device.jsonl"
    bus = f"hilsim:pty-{os.getpid()}"
    device = f"{sys.executable} -m firmware_sim.node --bus {bus} --seconds 1 --json-log {log}"

    def take_terminal() -> None:
        import fcntl

        os.setsid()
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    for interactive in ("", " --interactive"):
        shell = subprocess.Popen(
            ["bash", "-m", "-c", f"{device}{interactive} & wait $!"],
            stdin=theirs,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=take_terminal,
        )
        said, errors = shell.communicate(timeout=PATIENCE_S)
        assert shell.returncode == 0, (said, errors)
        assert "firmware-sim done" in said
    os.close(ours)
    os.close(theirs)
