"""The bridge's process in a live run: the live bridge, with faults injected into its sensors and its port.

Commands come in on a pipe. Every row goes to a log file at once, so that a killed process leaves all its rows.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import threading
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

from hilbridge.bus.port.spec import BusSpec
from hilbridge.bus.port.state import PortState
from hilbridge.config import BusConfig, Config
from hilbridge.errors import InputError
from hilbridge.priority import use_realtime_scheduling
from hilbridge.rows import CountersRow, EventRow, Row, encode
from hilbridge.runtime.account.judge import judge_by
from hilbridge.runtime.assemble import build_node
from hilbridge.runtime.live import LiveBridge
from hilbridge.runtime.provenance import first_rows
from hilscenario.format.schema import Scenario
from hilscenario.live.bridge.port import TappedPort
from hilscenario.live.bridge.senses import edge_senses
from hilscenario.world.fault_board import FaultBoard
from hilscenario.world.intent import make_predictor
from hilscenario.world.parts import parts_of
from hilscenario.world.sensing import person
from hilscenario.world.tap import Tap


@dataclass(frozen=True, slots=True)
class Job:
    """What a bridge process is to be: a scenario's bridge on a bus, its rows into `log`."""

    scenario: Scenario
    spec: BusSpec
    log: Path
    key_file: Path | None = None  # where a device of the user's own has another than the demo key
    on_a_bench: bool = False


# What the director tells a bridge process: a word and numbers.
#   go EPOCH_NS FAULTS     the scenario's time 0 on the monotonic clock; tick from then on, or from now if it is past;
#                          (STEP, NOW_NS) of the faults that are under way already
#   inject STEP NOW_NS     a fault of this process begins, at NOW_NS of the scenario's time
#   end STEP               ... and ends
#   stall SECONDS          block the event loop for so long
#   stop                   end after the tick under way
Order = tuple[str, int | float] | tuple[str, int, int] | tuple[str, int, tuple[tuple[int, int], ...]] | tuple[str]


class RowLog:
    """Rows as JSON lines, each handed to the system at once."""

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)

    def write(self, row: Row) -> None:
        """Append one; a recorder for the live bridge."""
        os.write(self._file, b'{"topic":"%b","time_ns":%d,"row":%b}\n' % (row.topic.encode(), row.time_ns, encode(row)))

    def write_effects(self, effects: list[int]) -> None:
        """How often each step of the script has taken effect in this process so far."""
        os.write(self._file, json.dumps({"effects": effects, "time_ns": time.monotonic_ns()}).encode() + b"\n")


class BridgeProcess:
    """The process's parts: board and taps for its share of the faults, the bridge, and the reader of commands."""

    def __init__(self, job: Job, orders: Connection) -> None:
        self._scenario, self._spec = job.scenario, job.spec
        self._key_file, self._on_a_bench = job.key_file, job.on_a_bench
        self._orders = orders
        self._log = RowLog(job.log)
        self._board = FaultBoard(job.scenario.steps)
        self._out = Tap("bridge", self._board, job.scenario.seed)
        self._into = Tap("device", self._board, job.scenario.seed)
        self._effects: list[int] = [0] * len(job.scenario.steps)
        self._live: LiveBridge | None = None

    async def run(self) -> None:
        """Connect, say so, wait for `go`, tick until `stop`. What cannot be opened is told instead of `ready`."""
        key_file = None if self._key_file is None else str(self._key_file)
        bus = BusConfig(spec=str(self._spec), key_file=key_file, arm=self._on_a_bench)
        parts = parts_of(self._scenario)
        options = {"node": "bridge"} if self._spec.interface == "hilsim" else {}
        port = TappedPort(self._spec, self._out, self._into, self._on_port_change, options)
        try:
            await port.connect()
        except InputError as error:
            self._orders.send(str(error))
            return
        try:
            self._orders.send("ready")
            epoch_ns = await asyncio.to_thread(self._await_go)
            if epoch_ns is None:
                return
            predict = make_predictor(self._scenario, epoch_ns)
            node = build_node(parts, port, bus, self._on_event, predict, on_a_bench=self._on_a_bench)
            senses = edge_senses(self._scenario, self._board, epoch_ns)
            judge = judge_by(person(self._scenario).truth, epoch_ns)
            self._live = LiveBridge(
                node, port, senses, self._log.write, judge=judge, on_tick=lambda row: self._note_effects()
            )
            for row in first_rows(Config(bus=bus), parts, port, self._scenario.name, time.monotonic_ns()):
                self._log.write(row)
            threading.Thread(target=self._obey, args=(asyncio.get_running_loop(),), daemon=True).start()
            use_realtime_scheduling()
            await asyncio.sleep(max(0.0, (epoch_ns - time.monotonic_ns()) / 1e9))
            await self._live.run()
        finally:
            self._note_effects()
            lost = {"bridge.tap_lost": self._out.lost, "device.tap_lost": self._into.lost}
            if self._live is not None:
                self._log.write(CountersRow(time.monotonic_ns(), {**self._live.counters(), **lost}))
            await port.close()

    def _await_go(self) -> int | None:
        match self._next_order():
            case ("go", int(epoch_ns), tuple(faults)):
                for number, now_ns in faults:
                    self._board.inject(number, now_ns)
                return epoch_ns
        return None

    def _next_order(self) -> Order:
        try:
            order: Order = self._orders.recv()
        except (EOFError, OSError):  # the director has gone
            return ("stop",)
        return order

    def _obey(self, loop: asyncio.AbstractEventLoop) -> None:
        while (order := self._next_order()) != ("stop",):
            loop.call_soon_threadsafe(self._carry_out, order)
        if self._live is not None:
            loop.call_soon_threadsafe(self._live.stop)

    def _carry_out(self, order: Order) -> None:
        match order:
            case ("inject", int(number), int(now_ns)):
                self._board.inject(number, now_ns)
            case ("end", int(number)):
                if self._board.end(number).step.fault == "bus.stale_queue" and self._live is not None:
                    port = self._live.port
                    assert isinstance(port, TappedPort)
                    port.release()
            case ("stall", seconds):
                time.sleep(float(seconds))

    def _note_effects(self) -> None:
        effects = [active.effects for active in self._board.all]
        if effects != self._effects:
            self._effects = effects
            self._log.write_effects(effects)

    def _on_event(self, now_ns: int, text: str) -> None:
        self._log.write(EventRow(now_ns, text))

    def _on_port_change(self, state: PortState) -> None:
        if self._live is not None:
            self._live.on_port_change(state)


def main(job: Job, orders: Connection) -> None:
    """The process's body."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the director, and it ends this
    asyncio.run(BridgeProcess(job, orders).run())
