"""The director of a live run: starts bridge and device, injects each fault when it is due, follows both logs, ends all.

One loop of a few milliseconds does everything. Times come from the processes' own stamps, so that a late loop changes no
verdict.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from firmware_sim.attachment import Attachment, BusUnusable
from firmware_sim.attachment import parse_spec as device_spec
from hilbridge.bus.port.spec import BusSpec
from hilbridge.errors import InputError
from hilbridge.limits import MS
from hilbridge.rows import Row, TickRow, from_fields
from hilscenario.format.schema import BusPart, Scenario
from hilscenario.format.vocabulary import INTRUDER_FAULTS, WIRE_FAULTS
from hilscenario.live.bridge_life import AWAY, BridgeLife
from hilscenario.live.clock import LiveClock
from hilscenario.live.device_world import DeviceWorld
from hilscenario.live.external import External, ExternalDevice, refuse_silence, reset
from hilscenario.live.intruder import LiveIntruder
from hilscenario.live.logs.bridge import missing_ticks
from hilscenario.live.logs.device import Ages, device_now
from hilscenario.live.logs.happened import Happened
from hilscenario.live.processes import BridgeHandle, DeviceHandle, LiveProcess, await_ready
from hilscenario.live.wire import SimulatedWire
from hilscenario.signals.bridge import absent_bridge, bridge_signals
from hilscenario.signals.device import DeviceLine, device_line
from hilscenario.signals.tracks import Value
from hilscenario.world.arm import PUSHING
from hilscenario.world.fault_board import Active, FaultBoard, fault_row
from hilscenario.world.script import Player

_POLL_NS = 8 * MS
_SENDING_POLL_NS = 2 * MS
_LEAD_NS = 200 * MS  # between `go` and the scenario's time 0
_GRACE_S = 60.0  # how much longer than the scenario a forgotten device lives
_SETTLE_NS = 100 * MS
_ASKS_FOR_QUIET_S = 0.15
_LISTENS_S = 0.6
_RESETS_S = 1.0
_SOON_NS = 5 * MS
_PUSH_NS = 10 * MS
_WATCH_NS = 50 * MS


class Director:
    """One live run. `run()` once; `happened` and `board` tell what came of it. Times are from the scenario's 0, in ns."""

    def __init__(self, scenario: Scenario, spec: BusSpec, folder: Path, external: External | None = None) -> None:
        self._external = external
        self._is_physical = device_spec(str(spec)).physical
        self.scenario, self.spec, self.folder = scenario, own_bus(scenario, spec), folder
        self.board = FaultBoard(scenario.steps)
        self.happened = Happened()
        self._now: dict[str, Value] = {}
        self._ages = Ages()
        self._clock = LiveClock()
        self._player = Player(self.board, self._clock, self)
        self._wire: SimulatedWire | None = None
        self._intruder: LiveIntruder | None = None
        self._device: DeviceHandle | ExternalDevice | None = None
        self._bridge: BridgeLife | None = None
        self._world = DeviceWorld(self.board, self._command)
        self._effects_before = [0] * len(scenario.steps)  # of bridge processes that have ended
        self._still_from: dict[int, int] = {}  # step -> since when the bridge hangs or stalls for it

    # From start to end

    def run(self) -> None:
        """Start, play, end. Whatever happens, no process is left. Raises InputError for what cannot be opened."""
        try:
            self._open()
            self._play()
        except BusUnusable as error:
            raise InputError(str(error)) from None
        finally:
            self._close()

    def _open(self) -> None:
        if self.spec.interface == "hilsim":
            self._wire = SimulatedWire(self.spec.channel, self.scenario.bus, self.scenario.seed)
        if self._external is not None and self._external.reset_command is not None:
            reset(self._external.reset_command)
            time.sleep(_RESETS_S)
        self._refuse_company()
        seconds = self.scenario.duration / 1e9
        arm = self.scenario.device.arm
        handles: list[BridgeHandle | DeviceHandle] = []
        if self._external is None:
            handles.append(device := DeviceHandle(self.spec, self.folder, arm, seconds + _GRACE_S))
            self._device = device
        else:
            command = self._external.reset_command or self.scenario.device.reset_command
            self._device = ExternalDevice(self.spec, self._external, arm, command, self.folder)
        asked = self._external or External()
        self._bridge = BridgeLife(
            self.scenario, self.spec, self.folder, asked.key_file, on_a_bench=asked.on_a_bench and self._is_physical
        )
        await_ready(*handles, self._bridge.handle)
        if any(step.fault in INTRUDER_FAULTS for step in self.scenario.steps):
            self._intruder = LiveIntruder(device_spec(str(self.spec)), self.scenario.seed)
        self.happened.start_ns = self._clock.start_ns = time.monotonic_ns() + _LEAD_NS
        self._bridge.go(self.happened.start_ns)

    def _refuse_company(self) -> None:
        """Another bridge or device on the same bus would be judged along with ours."""
        bus = Attachment(device_spec(str(self.spec)))
        try:
            time.sleep(_ASKS_FOR_QUIET_S if self._external is None else _LISTENS_S)
            heard = bus.read(time.monotonic_ns())
        finally:
            bus.close()
        if self._external is not None:
            refuse_silence(self.spec, {arrival.frame.can_id: arrival.frame.data for arrival in heard})
            return
        if heard:
            can_id = heard[0].frame.can_id
            raise InputError(
                f"bus {self.spec}: somebody is on it already ({can_id:#05x} was heard); end that, or use another"
            )

    def _play(self) -> None:
        self._player.start()
        self._watch_wire()
        while (now_ns := self._clock.now_ns()) < self.scenario.duration:
            self._follow()
            while (due := self._clock.take_due(self._clock.now_ns())) is not None:
                due()
            if self._intruder is not None:
                self._intruder.poll(time.monotonic_ns())
            longest_ns = _POLL_NS if self._intruder is None else _SENDING_POLL_NS
            next_ns = self._clock.next_ns
            wait_ns = longest_ns if next_ns is None else min(longest_ns, next_ns - now_ns)
            time.sleep(max(0, wait_ns) / 1e9)
        time.sleep(_SETTLE_NS / 1e9)  # rows of the last moment are still being written

    def _watch_wire(self) -> None:
        if self._wire is not None:
            self._wire.settle()
            self._clock.at(self._clock.now_ns() + _WATCH_NS, self._watch_wire)

    def _close(self) -> None:
        happened = self.happened
        # The bridge first: a device without a bridge falls back to following, as it must.
        handles = [self._bridge.handle if self._bridge else None, self._device]
        processes: list[LiveProcess | ExternalDevice] = [handle for handle in handles if handle is not None]
        for process in processes:
            on_purpose = process is not self._device and self._bridge is not None and self._bridge.dead
            if not process.alive and not on_purpose:
                happened.died.append(f"{process.name} (exit code {process.exit_code})")
            process.end()
        self._follow()
        for number, from_ns in self._still_from.items():
            self._count_missing(number, from_ns, self.scenario.duration)
        for process in processes:
            process.rows.close()
        if self._device is not None:
            happened.device_summary = self._device.summary()
        if self._intruder is not None:
            happened.intruder_dropped = self._intruder.dropped
            self._intruder.close()
        if self._wire is not None:
            self._wire.close()

    # Following the logs

    def _follow(self) -> None:
        """Read what both sides have written since; evaluate conditions after every row."""
        rows: list[tuple[int, dict[str, Any]]] = []
        if self._device is not None:
            rows += [(row["ends_ns"], row) for row in self._device.rows.new() if "ends_ns" in row]
        if self._bridge is not None:
            rows += [(row["time_ns"], row) for row in self._bridge.handle.rows.new()]
        for when_ns, row in sorted(rows, key=lambda entry: entry[0]):
            if "topic" in row:
                self._take_bridge_row(from_fields(row["topic"], when_ns, row["row"]))
            elif "effects" in row:
                self._take_effects(row["effects"])
            elif "command" in row:
                self._world.obeyed(row["command"])
                self.happened.events.append((when_ns, f"device obeys: {row['command']}"))
            else:
                self._take_device_line(device_line(row))
            self._player.look(when_ns - self._clock.start_ns, self._now)

    def _take_bridge_row(self, row: Row) -> None:
        self.happened.bridge_rows.append(row)
        if isinstance(row, TickRow):
            self._now.update(bridge_signals(row))

    def _take_effects(self, effects: list[int]) -> None:
        for active, before, more in zip(self.board.all, self._effects_before, effects, strict=True):
            if _within_the_bridge(active):
                active.effects = before + more

    def _take_device_line(self, line: DeviceLine) -> None:
        self.happened.device_lines.append(line)
        self._ages.take(line)
        self._now.update(device_now(line.row, self._ages))
        if not self.board.quiet:
            self._world.saw(line.row)

    # The script's executor

    def tell(self, now_ns: int, signals: Mapping[str, bool], text: str) -> None:
        """Faults under way, as signals and in words."""
        self._now.update(signals)
        self.happened.fault_signals.append((now_ns, dict(signals)))
        self.happened.events.append((now_ns + self._clock.start_ns, text))

    def begin(self, number: int, active: Active, now_ns: int) -> None:
        """Hand a fault to whoever carries it out: a signal, the wire, the third node, the device, the bridge's process."""
        fault = active.step.fault
        self.happened.faults.append(fault_row(number, active, now_ns + self._clock.start_ns, begins=True))
        if fault in AWAY:
            self._send_away(number, active, now_ns)
        elif self._wire is not None and self._wire.can(active):
            self._wire.begin(active)
        elif fault in INTRUDER_FAULTS:
            assert self._intruder is not None
            self._intruder.begin(active, time.monotonic_ns())
        elif fault.startswith("device."):
            self._world.change(active)
        elif _within_the_bridge(active):
            self._life.order(("inject", number, now_ns))
        if fault in PUSHING:
            self._push()

    def end(self, number: int, active: Active, now_ns: int) -> None:
        """Tell the same one that it is over."""
        fault = active.step.fault
        self.happened.faults.append(fault_row(number, active, now_ns + self._clock.start_ns, begins=False))
        if number in self._still_from:
            if fault == "bridge.hang":
                self._life.go_on()
            self._count_missing(number, self._still_from.pop(number), now_ns)
        elif self._wire is not None and self._wire.can(active):
            self._wire.end(active)
        elif fault in INTRUDER_FAULTS:
            assert self._intruder is not None
            self._intruder.end(active)
        elif fault.startswith("device."):
            self._world.change(active)
        elif _within_the_bridge(active):
            self._life.order(("end", number))

    @property
    def _life(self) -> BridgeLife:
        assert self._bridge is not None
        return self._bridge

    def _send_away(self, number: int, active: Active, now_ns: int) -> None:
        """The bridge's process hangs, stalls or dies; one that is dead already does none of it."""
        fault = active.step.fault
        if self._life.dead:
            return
        self.happened.away.append((now_ns, AWAY[fault]))
        self._now.update(absent_bridge(AWAY[fault]))
        if fault == "bridge.hang":
            self._still_from[number] = now_ns
            self._life.hang()
        elif fault == "bridge.stall":
            self._still_from[number] = now_ns
            until_ns = min(active.until_ns, self.scenario.duration)
            self._life.order(("stall", (until_ns - now_ns) / 1e9))
        else:
            active.took_effect(self._life.kill())
            self._follow()
            self._effects_before = [active.effects for active in self.board.all]
            if fault == "bridge.restart":
                self._life.start_again()
                self._clock.at(now_ns + round(active["down_ms"] * MS), self._come_back)

    def _come_back(self) -> None:
        faults = tuple(
            (number, active.from_ns)
            for number, active in enumerate(self.board.all)
            if self.board.get(active.step.fault) is active and _within_the_bridge(active)
        )
        if not self._life.go(self.happened.start_ns, faults):  # on a slow computer, as soon as possible
            self._clock.at(self._clock.now_ns() + _SOON_NS, self._come_back)

    def _count_missing(self, number: int, from_ns: int, until_ns: int) -> None:
        self._follow()
        self.board.all[number].took_effect(missing_ticks(self.happened.ticks, from_ns, until_ns))

    def _command(self, text: str) -> None:
        assert self._device is not None
        self._device.command(text)

    def _push(self) -> None:
        if self._world.push(float(self._now.get("device.assist_nm", 0.0)), self._clock.now_ns()):
            self._clock.at(self._clock.now_ns() + _PUSH_NS, self._push)


def own_bus(scenario: Scenario, spec: BusSpec) -> BusSpec:
    """A simulated bus outlives its nodes by seconds: one of another bit rate is another bus."""
    if scenario.bus.bitrate == BusPart().bitrate:
        return spec
    return BusSpec(spec.interface, f"{spec.channel}-{scenario.bus.bitrate}")


def _within_the_bridge(active: Active) -> bool:
    """Whether the bridge's own process carries the fault out: sensors, the wearer before them, taps of its port."""
    fault = active.step.fault
    elsewhere = fault in (*AWAY, *INTRUDER_FAULTS, *WIRE_FAULTS, "wearer.opposing")
    return not elsewhere and not fault.startswith("device.")
