"""Hung bridge: whatever becomes of the bridge or the link, the device is in FOLLOW with zero assist within 150 ms.

Measured in the device's own time, from the last command it accepted, at random phases, with real processes on a real
bus: the simulated one, and vcan0 where the kernel has it.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from hilbridge.bus.simulated.client import BusClient, BusNotReachable
from tests.safety.processes import hung_processes
from tests.safety.table import Row, Scale

LIMIT_MS = 150
FAULTS = ("stopped", "stalled", "killed", "link down", "link down and up")
AT_A_TIME = 2  # a trial waits most of its time
_PATIENCE_S = 120.0  # one processor, emulated, may take half a minute to start two processes


class Failed(AssertionError):
    """A trial that did not go as it must."""


def vcan_exists() -> bool:
    """Whether this kernel has a vcan0."""
    return Path("/sys/class/net/vcan0").exists()


class Trial:
    """One device, one bridge, one bus, until one of them breaks."""

    def __init__(self, bus: str, folder: Path, name: str) -> None:
        self.bus = bus
        self.log = folder / f"{name}.jsonl"
        self.offset = 0
        self.unread: deque[dict[str, Any]] = deque()
        self.running: list[BaseProcess] = []
        self.server: BaseProcess | None = None
        self.spec = bus if bus == "vcan0" else f"hilsim:{name}"
        if bus != "vcan0":
            self._serve(name)
        self.device = self._kept(hung_processes.device(self.spec, str(self.log)))
        self.bridge = self._kept(hung_processes.bridge(self.spec))

    def _kept(self, process: BaseProcess) -> BaseProcess:
        self.running.append(process)
        return process

    def _serve(self, name: str) -> None:
        self.server = self._kept(hung_processes.bus(name))
        self._await_server(name)

    def _await_server(self, name: str) -> None:
        """Until the bus answers: nodes that do not find it would each start one of their own."""
        until_s = time.monotonic() + _PATIENCE_S
        while time.monotonic() < until_s:
            try:
                BusClient(name, listen_only=True, start=False).close()
                return
            except BusNotReachable:
                time.sleep(0.02)
        raise Failed(f"no simulated bus {name} in {_PATIENCE_S:.0f} s")

    def records(self) -> list[dict[str, Any]]:
        """New whole lines of the device's log."""
        if not self.log.exists():
            return []
        with self.log.open("rb") as log:
            log.seek(self.offset)
            text = log.read()
        whole = text[: text.rfind(b"\n") + 1]
        self.offset += len(whole)
        return [record for line in whole.splitlines() if "state" in (record := json.loads(line))]

    def wait(self, what: str, wanted: Any) -> dict[str, Any]:
        """The first new record that is as wanted. Raises Failed after two minutes."""
        until_s = time.monotonic() + _PATIENCE_S
        last: dict[str, Any] = {}
        while time.monotonic() < until_s:
            self.unread.extend(self.records())
            while self.unread:
                last = self.unread.popleft()
                if wanted(last):
                    return last
            time.sleep(0.005)
        raise Failed(f"{self.spec}: no {what} in {_PATIENCE_S:.0f} s; last {last}")

    def link(self, up: bool) -> None:
        """Take the link down or up: the interface, or the process that is the simulated bus."""
        if self.bus == "vcan0":
            subprocess.run(["ip", "link", "set", "vcan0", "up" if up else "down"], check=True)
        elif up:
            name = self.spec.removeprefix("hilsim:")
            self._serve(name)
        elif self.server is not None:
            self.server.kill()

    def end(self) -> None:
        """Leave nothing behind."""
        if self.bus == "vcan0":
            subprocess.run(["ip", "link", "set", "vcan0", "up"], check=False)
        for process in reversed(self.running):
            process.kill()
            process.join()


def _latched(record: dict[str, Any]) -> bool:
    return record["reason"] == "RepeatedTrips" and record["state"] == "Latched" and record["assist_nm"] == 0.0


def reaction_ms(trial: Trial, fault: str, rng: random.Random) -> int:
    """Break it at a random phase; ms from the last accepted command to FOLLOW with zero assist."""
    while True:  # a machine under load may lose an assist by itself; only one that lasts until now is broken
        trial.wait("assist", lambda r: r["state"] == "Assist" and abs(r["assist_nm"]) > 0.02)
        time.sleep(rng.uniform(0.1, 0.5))
        trial.unread.clear()
        newest = trial.records()
        if newest and newest[-1]["state"] == "Assist":
            break
    if fault == "stopped":
        os.kill(trial.bridge.pid or 0, signal.SIGSTOP)
    elif fault == "stalled":
        os.kill(trial.bridge.pid or 0, signal.SIGUSR1)
    elif fault == "killed":
        trial.bridge.kill()
    else:
        trial.link(up=False)
    # A machine under load may have cost the device two trips before: then this third one latches it, as it must.
    ended = trial.wait("FOLLOW", lambda r: r["state"] == "Follow" or _latched(r))
    if ended["assist_nm"] != 0.0:
        raise Failed(f"{ended['state']} with assist: {ended}")
    if fault == "stopped":
        os.kill(trial.bridge.pid or 0, signal.SIGCONT)
    if fault == "link down and up":
        time.sleep(0.2)
        trial.link(up=True)
    if fault in ("stopped", "stalled", "link down and up") and ended["state"] == "Follow":
        between = trial.wait("return to ASSIST", lambda r: r["state"] in ("Ready", "Assist"))
        if between["state"] != "Ready":
            raise Failed(f"assist again without READY: {between}")
    elapsed: int = ended["t_ms"] - ended["accepted_ms"]
    return elapsed


def _tried(bus: str, folder: Path, k: int, seed: int) -> int | str:
    """One trial: ms to zero assist, or what went wrong."""
    fault = FAULTS[k % len(FAULTS)]
    try:
        trial = Trial(bus, folder, f"hung{os.getpid()}-{k}")
    except Failed as error:
        return f"{fault}: {error}"
    try:
        elapsed = reaction_ms(trial, fault, random.Random(f"{seed}/{k}"))
        return elapsed if elapsed <= LIMIT_MS else f"{fault}: {elapsed} ms"
    except Failed as error:
        return f"{fault}: {error}"
    finally:
        trial.end()


def campaign(bus: str, trials: int, seed: int) -> Row:
    """So many trials on one bus, all faults in turn; two at a time where each has a bus of its own."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(1 if bus == "vcan0" else AT_A_TIME) as pool:
        found = list(pool.map(lambda k: _tried(bus, Path(folder), k, seed), range(trials)))
    within = [elapsed for elapsed in found if isinstance(elapsed, int)]
    for line in found:
        if isinstance(line, str):
            print(line, file=sys.stderr)
    return Row(
        "hung",
        f"{'vcan0' if bus == 'vcan0' else 'simulated bus'}: stop, stall, kill, link: zero assist <= {LIMIT_MS} ms",
        f"{len(within)} of {trials}, worst {max(within, default=0)} ms",
        len(within) == trials,
    )


def run(scale: Scale) -> list[Row]:
    """300 on the simulated bus, 100 on vcan0; each as the machine allows, or the one that --bus names."""
    rows = []
    if scale.bus in ("auto", "hilsim"):
        rows.append(campaign("hilsim", scale.of(300, len(FAULTS)), scale.seed))
    if scale.bus == "vcan0" or (scale.bus == "auto" and vcan_exists()):
        rows.append(campaign("vcan0", scale.of(100, len(FAULTS)), scale.seed))
    elif scale.bus == "auto" and not scale.quick:
        figure = "no vcan0 here: `tests/vcan/run PYTHON -m tests.safety hung --bus vcan0` gives one"
        rows.append(Row("hung", "vcan0", figure, True))
    return rows
