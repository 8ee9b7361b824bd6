"""Bridge and device as processes: started, told, signalled, read and ended. Linux and macOS.

Both are forked from a server that has imported what they need, so that a catalogue, and a bridge that is killed and
started again, do not wait for imports (many seconds on a slow processor). The device is its own program, `main` and all.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import multiprocessing
import os
import signal
import sys
import time
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, BinaryIO

from hilbridge.bus.port.spec import BusSpec
from hilbridge.errors import InputError
from hilscenario.live.bridge import process
from hilscenario.live.bridge.process import Job, Order

START_S = 240.0  # the server's imports on a slow, busy processor included
_END_S = 10.0
_PR_SET_PDEATHSIG = 1
LOG_CYCLE_MS = 5

_fork = multiprocessing.get_context("forkserver")
_fork.set_forkserver_preload(["hilscenario.live.bridge.leash", "hilscenario.live.bridge.warm"])


class Lines:
    """A growing file of JSON lines: each whole one is given once."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: BinaryIO | None = None  # kept open: it is looked at hundreds of times a second
        self._rest = b""

    def new(self) -> list[dict[str, Any]]:
        """What has come since."""
        if self._file is None:
            if not self._path.exists():
                return []
            self._file = self._path.open("rb")
        *whole, self._rest = (self._rest + self._file.read()).split(b"\n")
        return [json.loads(line) for line in whole]

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()


class LiveProcess:
    """One process and the log it writes, ended for certain by `end`."""

    name = "process"

    def __init__(self, process: BaseProcess, log: Path) -> None:
        self.rows = Lines(log)
        self._process = process
        process.start()

    @property
    def alive(self) -> bool:
        return self._process.is_alive()

    @property
    def exit_code(self) -> int | None:
        return self._process.exitcode

    @property
    def pid(self) -> int:
        assert self._process.pid is not None
        return self._process.pid

    def signal(self, number: signal.Signals) -> None:
        """Send a signal; does nothing to a process that has ended."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, number)

    def kill(self) -> None:
        """Kill it, suspended or not, and wait for its end."""
        self._process.kill()
        self._process.join(_END_S)

    def end(self) -> None:
        """Wait a moment for it to end as asked; kill it if it does not."""
        self._process.join(_END_S)
        if self._process.is_alive():
            self.kill()


class BridgeHandle(LiveProcess):
    """One bridge process, from outside."""

    name = "bridge"

    def __init__(self, job: Job) -> None:
        self._orders, theirs = _fork.Pipe()
        super().__init__(_fork.Process(target=_bridge, args=(job, theirs), daemon=True), job.log)
        theirs.close()
        self._ready = False

    @property
    def ready(self) -> bool:
        """Whether it waits for `go`. Raises InputError for one that could not open its bus, or died."""
        if not self._ready and self._orders.poll():
            try:
                said = self._orders.recv()
            except EOFError:
                raise InputError(f"the bridge's process did not start (exit code {self.exit_code})") from None
            if said != "ready":
                raise InputError(said)
            self._ready = True
        return self._ready

    def order(self, order: Order) -> None:
        """Tell it; one that is dead is not told."""
        with contextlib.suppress(OSError):
            self._orders.send(order)

    def end(self) -> None:
        self.order(("stop",))
        self.signal(signal.SIGCONT)
        super().end()


class DeviceHandle(LiveProcess):
    """`firmware-sim` as a child, from outside."""

    name = "device"

    def __init__(self, spec: BusSpec, folder: Path, arm: str, seconds: float) -> None:
        """`seconds` bounds its life, whatever happens to its parent."""
        log, self._said = folder / "device.jsonl", folder / "device.out"
        words = ["--bus", str(spec), "--json-log", str(log), "--log-ms", str(LOG_CYCLE_MS)]
        words += ["--wearer-torque", arm, "--seconds", f"{seconds:.3f}"]
        theirs, self._commands = _fork.Pipe(duplex=False)
        super().__init__(_fork.Process(target=_device, args=(words, theirs, self._said), daemon=True), log)
        theirs.close()

    @property
    def ready(self) -> bool:
        """Whether it is on the bus. Raises InputError with what it said, for one that could not start."""
        said = self._said.read_text(encoding="utf-8") if self._said.exists() else ""
        if not self.alive:
            lines = said.strip().splitlines()
            raise InputError(f"the simulated device did not start: {lines[-1] if lines else 'it said nothing'}")
        return "firmware-sim ready" in said

    def command(self, text: str) -> None:
        """Type a command; its log shows when it was obeyed."""
        with contextlib.suppress(OSError):
            os.write(self._commands.fileno(), text.encode() + b"\n")

    def end(self) -> None:
        self.signal(signal.SIGTERM)
        super().end()

    def summary(self) -> dict[str, Any]:
        """Its last line; empty for a killed one."""
        done = "firmware-sim done "
        for line in self._said.read_text(encoding="utf-8").splitlines():
            if line.startswith(done):
                found: dict[str, Any] = json.loads(line.removeprefix(done))
                return found
        return {}


def await_ready(*handles: BridgeHandle | DeviceHandle) -> None:
    """Wait until all are ready. Raises InputError for one that does not get ready."""
    end_s = time.monotonic() + START_S
    while not all(handle.ready for handle in handles):
        if time.monotonic() > end_s:
            late = next(handle.name for handle in handles if not handle.ready)
            raise InputError(f"the {late}'s process did not start within {START_S:g} s; is this computer overloaded?")
        time.sleep(0.01)


def _die_with_parent() -> None:
    """Ask Linux to end this process, even a stopped one, when the director is killed."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        # The parent is the server, which ends with the last holder of this: let that be the director alone.
        os.close(forkserver._forkserver._forkserver_alive_fd)  # type: ignore[attr-defined]


def _bridge(job: Job, orders: Connection) -> None:
    _die_with_parent()
    process.main(job, orders)


def _device(words: list[str], commands: Connection, said: Path) -> None:
    from firmware_sim import node

    _die_with_parent()
    # Never closed here: a thread of the device waits for its next line until the process ends.
    sys.stdin = os.fdopen(os.dup(commands.fileno()), encoding="utf-8")
    sys.stdout = sys.stderr = said.open("w", encoding="utf-8", buffering=1)
    sys.exit(node.main(words))
