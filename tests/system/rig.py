"""A bridge process and a device process on one bus, and the device's own log of what happened when.

Both are forked from a server that has imported what they need, so that a campaign which kills its bridge twenty times
does not wait for twenty imports (17 s each where the kernel is itself a process).
"""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import random
import signal
import sys
import time
from collections.abc import Iterator
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import Any

SENSOR_FAULTS = ("gaze silent", "gaze gone", "camera frozen", "camera silent", "camera gone")
PROCESS_FAULTS = ("SIGSTOP", "SIGKILL")
LIMIT_MS = 150  # docs/protocol.md: command lost -> zero assist, at every phase
_PATIENCE_S = 60.0
_START_S = 240.0  # with the imports of the server that forks, on a machine that is busy with something else

_fork = multiprocessing.get_context("forkserver")
_fork.set_forkserver_preload(["pytest", "firmware_sim.node", "tests.system.sure_bridge"])


class Rig:
    """Starts the device at once and a bridge when asked; follows the device's log."""

    def __init__(self, bus: str, folder: Path) -> None:
        self.bus, self.folder = bus, folder
        self.bridge: ForkServerProcess | None = None
        self._devices = 0
        self._act_ms = 0
        self._start_device()

    def _start_device(self) -> None:
        self._devices += 1
        self.log = self.folder / f"device-{self._devices}.jsonl"
        self._position, self._partial = 0, ""
        arguments = ["--bus", self.bus, "--json-log", str(self.log), "--wearer-torque", "sway"]
        self.device = _fork.Process(target=_run_device, args=(arguments,), daemon=True)
        self.device.start()
        end = time.monotonic() + _START_S
        while not (self.log.exists() and self.log.stat().st_size):
            assert time.monotonic() < end, "the device did not start"
            assert self.device.is_alive(), f"the device ended with {self.device.exitcode}"
            time.sleep(0.01)

    def start_bridge(self) -> None:
        self._pipe, theirs = _fork.Pipe()
        self.bridge = _fork.Process(target=_run_bridge, args=(self.bus, theirs), daemon=True)
        self.bridge.start()
        theirs.close()
        assert self._pipe.poll(_START_S), "the bridge did not start"
        assert self._pipe.recv() == "ready"

    def records(self) -> Iterator[dict[str, Any]]:
        """Records of the log from where it was left, as they come, for at most a minute."""
        seen: dict[str, int] = {}
        last: dict[str, Any] = {}
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
                    last = row
                    seen[f"{row['state']} {row['reason']}"] = seen.get(f"{row['state']} {row['reason']}", 0) + 1
                    yield row
        raise AssertionError(
            f"the device's log did not show it within {_PATIENCE_S:g} s; "
            f"device {'alive' if self.device.is_alive() else 'dead'}, states {seen}, last {last}; bridge {self._ask()}"
        )

    def skip_to_now(self) -> None:
        self._position, self._partial = self.log.stat().st_size, ""

    def await_assist(self) -> None:
        """Until a device that is not about to latch gives assist torque under an accepted ACT."""
        self.skip_to_now()
        for row in self.records():
            if row["trips"] >= 2 or row["state"] == "Latched":
                _end(self.device)
                self._start_device()
                self.await_assist()
                return
            if row["state"] == "Assist" and not row["accepted_hold"] and abs(row["assist_nm"]) > 0.02:
                self._act_ms = row["accepted_ms"]
                return

    def time_to_follow_ms(self) -> tuple[int, int | None]:
        """From the last accepted ACT: device time until zero assist, and until FOLLOW.

        The second is None where the device came to READY: then a stalled computer had ended the assist for a reason of
        its own before the fault could, and the repeat says nothing about the way to FOLLOW.
        """
        zero_ms = None
        for row in self.records():
            if row["state"] == "Assist":
                zero_ms = None
                if not row["accepted_hold"]:
                    self._act_ms = row["accepted_ms"]
            elif zero_ms is None and row["assist_nm"] == 0.0:
                zero_ms = row["t_ms"]
            if zero_ms is not None and row["state"] in ("Follow", "Ready", "Latched"):
                followed = row["state"] == "Follow"
                return zero_ms - self._act_ms, row["t_ms"] - self._act_ms if followed else None
        raise AssertionError("unreachable")

    def inject(self, fault: str) -> None:
        assert self.bridge is not None
        if fault in PROCESS_FAULTS:
            _signal(self.bridge, getattr(signal, fault))
        else:
            self._pipe.send(fault)

    def recover(self, fault: str) -> None:
        """End the fault; a killed bridge is started again."""
        assert self.bridge is not None
        if fault == "SIGKILL":
            _end(self.bridge)
            self.start_bridge()
        elif fault == "SIGSTOP":
            _signal(self.bridge, signal.SIGCONT)
        else:
            self._pipe.send("well")

    def measure(self, fault: str, chance: random.Random) -> tuple[int, int | None]:
        """One repeat: assist, the fault at a random phase of the cycle, what the device did, recovery.

        Three trips in a minute latch a device, as they must: one that has two is replaced before the next repeat.
        """
        self.await_assist()
        time.sleep(chance.uniform(0.0, 0.12))
        self.inject(fault)
        try:
            return self.time_to_follow_ms()
        finally:
            self.recover(fault)

    def _ask(self) -> object:
        """What the bridge says of itself."""
        if self.bridge is None or not self.bridge.is_alive():
            return "dead"
        self._pipe.send("tell")
        return self._pipe.recv() if self._pipe.poll(5.0) else "silent"

    def close(self) -> None:
        for process in (self.bridge, self.device):
            if process is not None:
                _end(process)


def _run_device(arguments: list[str]) -> None:
    """What the device's process does: the program itself."""
    from firmware_sim import node

    with Path(os.devnull).open("w") as nowhere, contextlib.redirect_stdout(nowhere):
        sys.exit(node.main(arguments))


def _run_bridge(bus: str, pipe: Connection) -> None:
    from tests.system import sure_bridge

    sure_bridge.main(bus, pipe)


def _signal(process: ForkServerProcess, number: signal.Signals) -> None:
    assert process.pid is not None
    os.kill(process.pid, number)


def _end(process: ForkServerProcess) -> None:
    process.kill()
    process.join(_PATIENCE_S)
    process.close()
