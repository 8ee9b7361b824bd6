"""The director of a live run: starts bridge and device, strikes each fault when it is due, follows both logs, ends all.

Everything here is one loop of a few milliseconds; what happened when is read off the processes' own stamps, so that a
late look changes no verdict.
"""

from __future__ import annotations

import heapq
import math
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from firmware_sim.attachment import Attachment
from firmware_sim.attachment import parse_spec as device_spec
from hilbridge.bus.spec import BusSpec
from hilbridge.errors import InputError
from scenarios.bridge_signals import absent_bridge, bridge_signals
from scenarios.engine import tremor_torque_nm
from scenarios.faults import Active, FaultBoard
from scenarios.live import intruder
from scenarios.live.bridge import Job
from scenarios.live.bridge_log import missing_ticks
from scenarios.live.device_log import Ages, device_now
from scenarios.live.intruder import LiveIntruder
from scenarios.live.processes import BridgeHandle, DeviceHandle, LiveProcess, await_ready
from scenarios.live.wire import SimulatedWire
from scenarios.schema import BusPart, Scenario
from scenarios.stl import holds_now, signal_names
from scenarios.tracks import Value
from scenarios.vocabulary import fault_kind

MS = 1_000_000
_POLL_S = 0.008
_SENDING_POLL_S = 0.002
_LEAD_NS = 200 * MS  # between `go` and the scenario's time 0
_GRACE_S = 60.0  # how much longer than the scenario a forgotten device lives
_SETTLE_NS = 100 * MS
_ASKS_FOR_QUIET_S = 0.15
_OF_THE_WIRE = ("bus.cut", "bus.bus_off")
_IN_THE_DEVICE = ("device.sensor_fault", "device.actuator_lag", "device.torque_bias")
_AWAY = {"bridge.hang": "hung", "bridge.stall": "stalled", "bridge.kill": "dead", "bridge.restart": "dead"}
_PUSH_NS = 10 * MS
_WATCH_NS = 50 * MS


@dataclass(slots=True)
class Happened:
    """What a live run left: rows of both sides with their own stamps (monotonic ns), faults, and how it ended."""

    start_ns: int = 0
    device_rows: list[dict[str, Any]] = field(default_factory=list)
    bridge_rows: list[dict[str, Any]] = field(default_factory=list)  # topic, time_ns, row
    fault_signals: list[tuple[int, dict[str, bool]]] = field(default_factory=list)
    events: list[tuple[int, str]] = field(default_factory=list)
    away: list[tuple[int, str]] = field(default_factory=list)
    died: list[str] = field(default_factory=list)
    device_summary: dict[str, Any] = field(default_factory=dict)
    intruder_dropped: int = 0

    @property
    def ticks(self) -> list[tuple[int, dict[str, Any]]]:
        """The bridge's ticks, by time from the scenario's 0."""
        return [(row["time_ns"] - self.start_ns, row["row"]) for row in self.bridge_rows if row["topic"] == "/tick"]


class Director:
    """One live run. `run()` once; `happened` and `board` tell what came of it. Times are from the scenario's 0, in ns."""

    def __init__(self, scenario: Scenario, spec: BusSpec, folder: Path) -> None:
        self.scenario, self.spec, self.folder = scenario, own_bus(scenario, spec), folder
        self.board = FaultBoard(scenario.steps)
        self.happened = Happened()
        self._now: dict[str, Value] = {}
        self._ages = Ages()
        self._heap: list[tuple[int, int, Callable[[], None]]] = []
        self._order = 0
        self._waiting = {number for number, step in enumerate(scenario.steps) if step.when is not None}
        self._names = {number: signal_names(scenario.steps[number].when or "") for number in self._waiting}
        self._wire: SimulatedWire | None = None
        self._intruder: LiveIntruder | None = None
        self._device: DeviceHandle | None = None
        self._bridge: BridgeHandle | None = None
        self._bridges = 0
        self._effects_before = [0] * len(scenario.steps)  # of bridge processes that have ended
        self._hang_from: dict[int, int] = {}
        self._gone_until_ns = 0
        self._dead_on_purpose = False
        self._obeyed: set[str] = set()
        self._pushed_nm = 0.0

    # From start to end

    def run(self) -> None:
        """Start, play, end. Whatever happens, no process is left. Raises InputError for what cannot be opened."""
        try:
            self._open()
            self._play()
        finally:
            self._close()

    def _open(self) -> None:
        if self.spec.interface == "hilsim":
            self._wire = SimulatedWire(self.spec.channel, self.scenario.bus, self.scenario.seed)
        self._refuse_company()
        seconds = self.scenario.duration / 1e9
        self._device = DeviceHandle(self.spec, self.folder, self.scenario.device.arm, seconds + _GRACE_S)
        self._bridge = self._new_bridge()
        await_ready(self._device, self._bridge)
        if any(step.fault in intruder.FAULTS for step in self.scenario.steps):
            self._intruder = LiveIntruder(device_spec(str(self.spec)), self.scenario.seed)
        self.happened.start_ns = time.monotonic_ns() + _LEAD_NS
        self._bridge.order(("go", self.happened.start_ns))

    def _refuse_company(self) -> None:
        """Another bridge or device on the same bus would be judged along with ours."""
        bus = Attachment(device_spec(str(self.spec)))
        try:
            time.sleep(_ASKS_FOR_QUIET_S)
            heard = bus.read(time.monotonic_ns())
        finally:
            bus.close()
        if heard:
            can_id = heard[0].frame.can_id
            raise InputError(
                f"bus {self.spec}: somebody is on it already ({can_id:#05x} was heard); end that, or use another"
            )

    def _new_bridge(self) -> BridgeHandle:
        self._bridges += 1
        return BridgeHandle(Job(self.scenario, self.spec, self.folder / f"bridge-{self._bridges}.jsonl"))

    def _play(self) -> None:
        for number, step in enumerate(self.scenario.steps):
            if step.at is not None:
                self._at(step.at, partial(self._strike, number))
        self._watch_wire()
        while (now_ns := self._clock()) < self.scenario.duration:
            self._follow()
            while self._heap and self._heap[0][0] <= self._clock():
                heapq.heappop(self._heap)[2]()
            if self._intruder is not None:
                self._intruder.poll(time.monotonic_ns())
            next_ns = self._heap[0][0] if self._heap else self.scenario.duration
            longest_s = _POLL_S if self._intruder is None else _SENDING_POLL_S
            time.sleep(max(0.0, min(longest_s, (next_ns - now_ns) / 1e9)))
        time.sleep(_SETTLE_NS / 1e9)  # rows of the last moment are still being written

    def _watch_wire(self) -> None:
        if self._wire is not None:
            self._wire.settle()
            self._at(self._clock() + _WATCH_NS, self._watch_wire)

    def _close(self) -> None:
        happened = self.happened
        # The bridge first: a device without a bridge falls back to following, as it must.
        for process in (self._bridge, self._device):
            if process is not None:
                self._say_if_dead(process)
                process.end()
        self._follow()
        for number, from_ns in self._hang_from.items():
            self._count_missing(number, from_ns, self.scenario.duration)
        for process in (self._bridge, self._device):
            if process is not None:
                process.rows.close()
        if self._device is not None:
            happened.device_summary = self._device.summary()
        if self._intruder is not None:
            happened.intruder_dropped = self._intruder.dropped
            self._intruder.close()
        if self._wire is not None:
            self._wire.close()

    def _say_if_dead(self, process: LiveProcess) -> None:
        on_purpose = process is self._bridge and self._dead_on_purpose
        if not process.alive and not on_purpose:
            self.happened.died.append(f"{process.name} (exit code {process.exit_code})")

    def _clock(self) -> int:
        return time.monotonic_ns() - self.happened.start_ns

    def _at(self, when_ns: int, do: Callable[[], None]) -> None:
        self._order += 1
        heapq.heappush(self._heap, (when_ns, self._order, do))

    # Following the logs

    def _follow(self) -> None:
        """Take in what both sides have written since; conditions are looked at after every row."""
        rows: list[tuple[int, dict[str, Any]]] = []
        if self._device is not None:
            rows += [(row["ends_ns"], row) for row in self._device.rows.new() if "ends_ns" in row]
        if self._bridge is not None:
            rows += [(row["time_ns"], row) for row in self._bridge.rows.new()]
        for when_ns, row in sorted(rows, key=lambda entry: entry[0]):
            if "topic" in row:
                self._take_bridge_row(row)
            elif "command" in row:
                self._obeyed.add(row["command"].split()[0])
                self.happened.events.append((when_ns, f"device obeys: {row['command']}"))
            else:
                self._take_device_row(row)
            self._look_for_conditions(when_ns - self.happened.start_ns)

    def _take_bridge_row(self, row: dict[str, Any]) -> None:
        self.happened.bridge_rows.append(row)
        if row["topic"] == "/tick":
            self._now.update(bridge_signals(row["row"]))
        elif row["topic"] == "/effects":
            for active, before, more in zip(self.board.all, self._effects_before, row["row"]["effects"], strict=True):
                if _within_the_bridge(active):
                    active.effects = before + more

    def _take_device_row(self, row: dict[str, Any]) -> None:
        self.happened.device_rows.append(row)
        self._ages.take(row)
        self._now.update(device_now(row, self._ages))
        if self.board.quiet:
            return
        torque = any(row[part] for part in ("assist_nm", "gravity_nm", "follow_nm"))
        for fault, command in zip(_IN_THE_DEVICE, ("encoder", "lag", "bias"), strict=True):
            active = self.board.get(fault)
            # A lag does nothing to a motor that gives no torque.
            if active is not None and command in self._obeyed and (torque or command != "lag"):
                active.took_effect()

    def _look_for_conditions(self, when_ns: int) -> None:
        for number in sorted(self._waiting):
            step = self.scenario.steps[number]
            if self._names[number] <= self._now.keys() and holds_now(step.when or "", self._now):
                self._waiting.discard(number)
                self._at(when_ns + step.after, partial(self._strike, number))

    # Faults

    def _strike(self, number: int) -> None:
        now_ns, step = self._clock(), self.scenario.steps[number]
        active = self.board.strike(number, now_ns)
        self._note_faults(now_ns, f"fault: {step.fault} begins")
        self._begin(number, active, now_ns)
        if step.for_ is not None:
            self._at(now_ns + step.for_, partial(self._finish, number))
        elif fault_kind(step.fault).instant:
            # An instant is over at once; its mark stays for a millisecond, so that expectations can see it.
            self._at(now_ns + MS, partial(self._finish, number))
        if step.every is not None:
            self._at((step.at or 0) + active.strikes * step.every, partial(self._strike, number))

    def _finish(self, number: int) -> None:
        now_ns = self._clock()
        active = self.board.end(number)
        self._note_faults(now_ns, f"fault: {active.step.fault} ends")
        self._end(number, active, now_ns)

    def _note_faults(self, now_ns: int, text: str) -> None:
        signals = self.board.signals()
        self._now.update(signals)
        self.happened.fault_signals.append((now_ns, dict(signals)))
        self.happened.events.append((now_ns + self.happened.start_ns, text))

    def _begin(self, number: int, active: Active, now_ns: int) -> None:
        fault = active.step.fault
        if fault in _AWAY:
            self._begin_with_the_process(number, active, now_ns)
        elif fault in intruder.FAULTS:
            assert self._intruder is not None
            self._intruder.begin(active, time.monotonic_ns())
        elif fault in _OF_THE_WIRE:
            assert self._wire is not None
            self._wire.begin(active)
        elif fault == "device.tick_overrun":
            self._command(f"overrun {round(active['overrun_ms'])}")
            active.took_effect()
        elif fault.startswith("device."):
            self._break_device()
        elif fault == "wearer.opposing":
            self._push()
        else:
            self._tell_bridge(("strike", number, now_ns))
            if fault == "wearer.tremor":
                self._push()

    def _end(self, number: int, active: Active, now_ns: int) -> None:
        fault = active.step.fault
        if fault == "bridge.hang":
            self._process().signal(signal.SIGCONT)
            self._count_missing(number, self._hang_from.pop(number, now_ns), now_ns)
        elif fault == "bridge.stall":
            self._count_missing(number, self._hang_from.pop(number, now_ns), now_ns)
        elif fault in intruder.FAULTS:
            assert self._intruder is not None
            self._intruder.end(active)
        elif fault in _OF_THE_WIRE:
            assert self._wire is not None
            self._wire.end(active)
        elif fault in _IN_THE_DEVICE:
            self._break_device()
        elif _within_the_bridge(active):
            self._tell_bridge(("end", number))

    # ... of the bridge's process

    def _begin_with_the_process(self, number: int, active: Active, now_ns: int) -> None:
        fault, process = active.step.fault, self._process()
        if not self._dead_on_purpose:
            self.happened.away.append((now_ns, _AWAY[fault]))
            self._now.update(absent_bridge(_AWAY[fault]))
        if fault in ("bridge.hang", "bridge.stall"):
            self._hang_from[number] = now_ns
            if fault == "bridge.hang":
                process.signal(signal.SIGSTOP)
            else:
                until_ns = min(active.until_ns, self.scenario.duration)
                self._tell_bridge(("stall", (until_ns - now_ns) / 1e9))
            return
        if self._dead_on_purpose:
            return
        self._dead_on_purpose = True
        process.kill()
        active.took_effect(not process.alive)
        self._follow()
        self._effects_before = [active.effects for active in self.board.all]
        if fault == "bridge.restart":
            process.rows.close()
            self._bridge = self._new_bridge()
            self._at(now_ns + round(active["down_ms"] * MS), self._come_back)

    def _come_back(self) -> None:
        bridge = self._process()
        if not bridge.ready:  # a slow computer: as soon as it is
            self._at(self._clock() + 5 * MS, self._come_back)
            return
        self._dead_on_purpose = False
        for number, active in enumerate(self.board.all):
            if self.board.get(active.step.fault) is active and _within_the_bridge(active):
                bridge.order(("strike", number, active.from_ns))
        bridge.order(("go", self.happened.start_ns))

    def _process(self) -> BridgeHandle:
        assert self._bridge is not None
        return self._bridge

    def _tell_bridge(self, order: Any) -> None:
        self._process().order(order)

    def _count_missing(self, number: int, from_ns: int, until_ns: int) -> None:
        self._follow()
        self.board.all[number].took_effect(missing_ticks(self.happened.ticks, from_ns, until_ns))

    # ... of the device's world

    def _command(self, text: str) -> None:
        assert self._device is not None
        self._device.command(text)

    def _break_device(self) -> None:
        """The device's world as all its faults under way make it: one that ends leaves the others as they are."""
        self._obeyed -= {"encoder", "lag", "bias"}
        sensor, lag, bias = map(self.board.get, _IN_THE_DEVICE)
        self._command(f"encoder {0 if sensor is None else round(sensor['offset_deg'] * 1000)}")
        self._command("mend")
        if lag is not None:
            self._command(f"lag {lag['time_constant_ms']:g}")
        if bias is not None:
            self._command(f"bias {bias['bias_nm']:g}")

    def _push(self) -> None:
        """What the wearer's arm does besides: trembles, and pushes against the assist; again while one is under way."""
        opposing, tremor = self.board.get("wearer.opposing"), self.board.get("wearer.tremor")
        assist_nm = float(self._now.get("device.assist_nm", 0.0))
        push_nm = 0.0 if tremor is None else tremor_torque_nm(tremor, self._clock())
        if opposing is not None and assist_nm:
            push_nm -= math.copysign(opposing["torque_nm"], assist_nm)
            opposing.took_effect("push" in self._obeyed)
        if push_nm != self._pushed_nm:
            self._pushed_nm = push_nm
            self._command(f"push {push_nm:.4f}")
        if opposing is not None or tremor is not None:
            self._at(self._clock() + _PUSH_NS, self._push)


def own_bus(scenario: Scenario, spec: BusSpec) -> BusSpec:
    """A simulated bus outlives its nodes by seconds: one of another bit rate is another bus."""
    if scenario.bus.bitrate == BusPart().bitrate:
        return spec
    return BusSpec(spec.interface, f"{spec.channel}-{scenario.bus.bitrate}")


def _within_the_bridge(active: Active) -> bool:
    """Whether the bridge's own process carries the fault out: sensors, the wearer before them, taps of its port."""
    fault = active.step.fault
    if fault in (*_AWAY, *intruder.FAULTS, *_OF_THE_WIRE, "wearer.opposing"):
        return False
    return not fault.startswith("device.")
