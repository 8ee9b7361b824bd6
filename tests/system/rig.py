"""A bridge process and a device process on one bus, and the device's own log of what happened when."""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

BRIDGE = Path(__file__).with_name("sure_bridge.py")
SENSOR_FAULTS = ("gaze silent", "gaze gone", "camera frozen", "camera silent", "camera gone")
PROCESS_FAULTS = ("SIGSTOP", "SIGKILL")
LIMIT_MS = 150  # PROTOCOL: command lost -> zero assist, at every phase
_PATIENCE_S = 60.0


class Rig:
    """Starts the device at once and a bridge when asked; follows the device's log."""

    def __init__(self, bus: str, folder: Path) -> None:
        self.bus, self.folder = bus, folder
        self.bridge: subprocess.Popen[str] | None = None
        self._devices = 0
        self._act_ms = 0
        self._start_device()

    def _start_device(self) -> None:
        self._devices += 1
        self.log = self.folder / f"device-{self._devices}.jsonl"
        self._position, self._partial = 0, ""
        command = ["-m", "firmware_sim.node", "--bus", self.bus, "--json-log", str(self.log), "--wearer-torque", "sway"]
        self.device = _python(*command)
        assert "ready" in _line(self.device)

    def start_bridge(self) -> None:
        self.bridge = _python(str(BRIDGE), self.bus)
        assert _line(self.bridge).strip() == "ready"

    def records(self) -> Iterator[dict[str, Any]]:
        """Records of the log from where it was left, as they come, for at most half a minute."""
        end = time.monotonic() + _PATIENCE_S
        with self.log.open(encoding="utf-8") as file:
            file.seek(self._position)
            while time.monotonic() < end:
                chunk = file.readline()
                if not chunk.endswith("\n"):
                    self._partial += chunk
                    time.sleep(0.002)
                    continue
                self._position = file.tell()
                row, self._partial = json.loads(self._partial + chunk), ""
                if "state" in row:
                    yield row
        raise AssertionError(f"the device's log did not show it within {_PATIENCE_S:g} s")

    def skip_to_now(self) -> None:
        self._position, self._partial = self.log.stat().st_size, ""

    def await_assist(self) -> None:
        """Until a device that is not about to latch gives assist torque under an accepted ACT."""
        self.skip_to_now()
        for row in self.records():
            if row["trips"] >= 2 or row["state"] == "LATCHED":
                _end(self.device)
                self._start_device()
                self.await_assist()
                return
            if row["state"] == "ASSIST" and not row["accepted_hold"] and abs(row["assist_nm"]) > 0.02:
                self._act_ms = row["accepted_ms"]
                return

    def time_to_follow_ms(self) -> tuple[int, int | None]:
        """From the last accepted ACT: device time until zero assist, and until FOLLOW.

        The second is None where the device came to READY: then a stalled computer had ended the assist for a reason of
        its own before the fault could, and the repeat says nothing about the way to FOLLOW.
        """
        zero_ms = None
        for row in self.records():
            if row["state"] == "ASSIST":
                zero_ms = None
                if not row["accepted_hold"]:
                    self._act_ms = row["accepted_ms"]
            elif zero_ms is None and row["assist_nm"] == 0.0:
                zero_ms = row["t_ms"]
            if zero_ms is not None and row["state"] in ("FOLLOW", "READY", "LATCHED"):
                followed = row["state"] == "FOLLOW"
                return zero_ms - self._act_ms, row["t_ms"] - self._act_ms if followed else None
        raise AssertionError("unreachable")

    def inject(self, fault: str) -> None:
        assert self.bridge is not None
        if fault in PROCESS_FAULTS:
            self.bridge.send_signal(getattr(signal, fault))
        else:
            self._tell(fault)

    def recover(self, fault: str) -> None:
        """End the fault; a killed bridge is started again."""
        assert self.bridge is not None
        if fault == "SIGKILL":
            _end(self.bridge)
            self.start_bridge()
        elif fault == "SIGSTOP":
            self.bridge.send_signal(signal.SIGCONT)
        else:
            self._tell("well")

    def measure(self, fault: str, chance: random.Random) -> tuple[int, int | None]:
        """One repeat: assist, the fault at a random phase of the cycle, what the device did, recovery.

        Three trips in a minute latch a device, as they must: one that has two is replaced before the next repeat.
        """
        self.await_assist()
        time.sleep(chance.uniform(0.0, 0.12))
        self.inject(fault)
        result = self.time_to_follow_ms()
        self.recover(fault)
        return result

    def close(self) -> None:
        for process in (self.bridge, self.device):
            if process is not None:
                _end(process)

    def _tell(self, line: str) -> None:
        assert self.bridge is not None
        assert self.bridge.stdin is not None
        self.bridge.stdin.write(line + "\n")
        self.bridge.stdin.flush()


def _python(*arguments: str) -> subprocess.Popen[str]:
    pipe = subprocess.PIPE
    return subprocess.Popen([sys.executable, *arguments], stdin=pipe, stdout=pipe, text=True)


def _line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline()


def _end(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.communicate()
