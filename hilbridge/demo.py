"""The demo: a simulated wearer in front of the bridge, a simulated device in a process of its own behind the bus."""

from __future__ import annotations

import asyncio
import importlib.util
import json
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hilbridge.bus.port.spec import parse_spec
from hilbridge.config import BusConfig, Config, ModelConfig, MonitorConfig
from hilbridge.errors import InputError
from hilbridge.lease import leased
from hilbridge.run import Outcome, RunOptions, Watcher, run_bridge
from hilbridge.runtime.account.judge import judge_by
from hilbridge.runtime.assemble import read_parts
from hilbridge.runtime.live import LiveBridge
from hilbridge.runtime.simulated_senses import SimulatedSenses
from hilbridge.wearer.person import Wearer
from hilbridge.wearer.shaking import Tremor

DEMO_SEED = 3  # a person the shipped bundle was not trained on
_DEVICE_START_S = 30.0
# For what is still on the wire when the bridge has stopped, and until the device follows by itself.
_LAST_FRAMES_S = 0.3


@dataclass(frozen=True, slots=True)
class DemoOptions:
    """seconds: length. seed: which person and session. tremor_hz: 0 for none. out: folder for what it leaves behind.

    bundle: None for the one that ships. open_page: show the operator's page in a browser meanwhile, where the extra
    `monitor` is installed.
    """

    seconds: float
    out: Path
    bus: str = "auto"
    seed: int = DEMO_SEED
    tremor_hz: float = 0.0
    bundle: Path | None = None
    open_page: bool = False


class DeviceProcess:
    """`firmware-sim` as a child process: started, awaited until it is on the bus, stopped, its last word read."""

    def __init__(self, bus: str, log: Path) -> None:
        command = [sys.executable, "-m", "firmware_sim.node", "--bus", bus, "--json-log", str(log)]
        # The pipe is the device's lease: however this process ends, the device sees its end and goes too.
        command.append("--until-input-ends")
        self.summary: dict[str, Any] = {}
        self.failure = ""  # its last word, where it ended before it was asked to
        self._stopped = False
        self._lines: queue.Queue[str | None] = queue.Queue()
        # A session of its own: a Ctrl-C at the terminal is the bridge's, and the device must see the bridge stop.
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        threading.Thread(target=self._read, daemon=True).start()
        line = self._next_line(_DEVICE_START_S)
        if line is None or "ready" not in line:
            self._process.kill()
            _, errors = self._process.communicate()
            said = (errors or "").strip().splitlines()
            raise InputError(f"the simulated device did not start: {said[-1] if said else 'it said nothing'}")

    def stop(self) -> None:
        """Ask it to end and read its summary; kill it when it does not answer. May be called again."""
        if self._stopped:
            return
        self._stopped = True
        ended_early = self._process.poll() not in (None, 0)
        self._process.terminate()
        while (line := self._next_line(5.0)) is not None:
            if line.startswith("firmware-sim done "):
                self.summary = json.loads(line.removeprefix("firmware-sim done "))
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if ended_early and not self.failure and self._process.stderr is not None:
            said = self._process.stderr.read().strip().splitlines()
            self.failure = said[-1] if said else f"exit code {self._process.returncode}"

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line)
        self._lines.put(None)

    def _next_line(self, timeout_s: float) -> str | None:
        try:
            return self._lines.get(timeout=timeout_s)
        except queue.Empty:
            return None


@contextmanager
def live_page(bus: str) -> Iterator[None]:
    """The operator's page in a browser while it lasts; a process of its own, which ends with this one."""
    command = leased([sys.executable, "-m", "hilbridge", "monitor", "--bus", bus, "--open"])
    # What it says, its address among it, goes to where notices go: standard output is for what the demo came to.
    page = subprocess.Popen(command, stdout=sys.stderr)
    try:
        yield
    finally:
        page.terminate()
        page.wait()


def run_demo(options: DemoOptions, watcher: Watcher) -> Outcome:
    """Run it and write recording and report into `options.out`. Raises InputError when something cannot be opened."""
    bus = parse_spec(options.bus)
    # A simulated bus of one's own: two demos at once do not meet.
    name = f"hilsim:demo-{os.getpid()}" if bus.interface == "hilsim" and options.bus == "auto" else str(bus)
    if bus.interface == "virtual":
        raise InputError(f"bus {name}: reaches no other process, and the device is one; use hilsim:NAME")
    with_page = options.open_page and importlib.util.find_spec("aiohttp") is not None
    # The picture is drawn: nobody is in it.
    model = ModelConfig(bundle=None if options.bundle is None else str(options.bundle))
    config = Config(bus=BusConfig(spec=name), model=model, monitor=MonitorConfig(share_pictures=with_page))
    parts = read_parts(config)
    try:
        options.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"out {options.out}: {error.strerror}; name a folder that can be written") from None
    tremor = Tremor(options.tremor_hz) if options.tremor_hz > 0 else None

    def make_wearer() -> Wearer:
        return Wearer(options.seed, tremor=tremor)

    device = DeviceProcess(name, options.out / "device.jsonl")
    try:
        senses = SimulatedSenses(make_wearer, config.sensors)

        def finish(live: LiveBridge) -> Mapping[str, int]:
            time.sleep(_LAST_FRAMES_S)
            device.stop()
            told = device.summary
            unheard = max(0, live.port.counters.sent - int(told.get("received", 0)))
            lost = live.counters(int(told["send_dropped"]) if "send_dropped" in told else None)["frames_lost"]
            return {"frames_lost": lost + unheard, "frames_unheard_by_device": unheard}

        asked = RunOptions(
            f"demo: simulated wearer {options.seed} against a simulated device",
            options.seconds,
            judge=judge_by(make_wearer().truth, senses.epoch_ns),
            finish=finish,
        )
        with live_page(name) if with_page else nullcontext():
            outcome = asyncio.run(run_bridge(config, parts, senses, options.out, asked, watcher))
    finally:
        device.stop()
    if device.failure:
        raise InputError(f"the simulated device ended early: {device.failure}; saved: {outcome.recording}")
    return outcome
