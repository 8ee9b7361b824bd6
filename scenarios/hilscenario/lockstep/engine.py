"""The lockstep engine: bridge, predictor, bit-level bus, controller at 1 kHz, arm and wearer on one time line.

Every part is the code that runs live; only clock and sockets are the engine's. Time is the world's, in ns from 0; the
device's clock runs off by the scenario's ppm. The same scenario and seed give the same run, to the byte.

What happens now and then waits on the clock's agenda. The device's tick, of which there are a thousand a second, also
moves the bus and the bridge's inbox; what it calls costs next to nothing while nothing has changed.
"""

from __future__ import annotations

import random
from collections.abc import Mapping

from firmware_sim.memory import COUNT_LOST
from hilbridge.limits import MS
from hilbridge.rows import EventRow
from hilbridge.runtime.assemble import Parts
from hilscenario.format.schema import Scenario
from hilscenario.format.vocabulary import INTRUDER_FAULTS, WIRE_FAULTS
from hilscenario.lockstep.bridge_side import BridgeSide
from hilscenario.lockstep.bus_side import BusSide
from hilscenario.lockstep.clock import WorldClock
from hilscenario.lockstep.device_side import DeviceSide
from hilscenario.lockstep.intruder import Intruder
from hilscenario.lockstep.run_log import Record, RunLog
from hilscenario.signals.device import DEVICE_COUNTERS
from hilscenario.world.arm import PUSHING
from hilscenario.world.fault_board import Active, FaultBoard, fault_row
from hilscenario.world.recorded import Person
from hilscenario.world.script import Player
from hilscenario.world.sensing import Body


class Lockstep:
    """One run. `run()` once; `log`, `board`, `device_side` and `bridge` tell what happened."""

    def __init__(
        self,
        scenario: Scenario,
        record: Record | None = None,
        *,
        parts: Parts | None = None,
        wearer: Person | None = None,
    ) -> None:
        """`record` takes the rows of a recording; None where nobody keeps one.

        parts, wearer: bundle and gate, and a person, in place of the scenario's own.
        """
        self.scenario = scenario
        chance = random.Random(scenario.seed)
        self.clock = clock = WorldClock()
        self.log = log = RunLog(record)
        self.board = board = FaultBoard(scenario.steps)
        self.body = Body(scenario, board, wearer)
        self.bus = bus = BusSide(scenario.bus, scenario.seed, clock, board, chance)
        self.device_side = DeviceSide(scenario, board, bus, log, chance)
        self.bridge = BridgeSide(scenario, clock, board, bus, log, self.body, parts)
        self.intruder = Intruder(scenario, clock, board, bus, self.bridge.tap)
        self.player = Player(board, clock, self)
        self._looked_at = -1  # version of the signals that conditions were last looked at on

    def run(self) -> None:
        """From 0 to the scenario's end."""
        self.player.start()
        self.bridge.start()
        tick_ns = round(MS * (1.0 + self.scenario.device.clock_ppm * 1e-6))
        self.clock.run(self.scenario.duration, tick_ns, self._tick)

    def _tick(self, now_ns: int) -> None:
        """One tick of the device; or, where nobody else has anything to do meanwhile, all until somebody has."""
        due_ns = self.bus.catch_up(now_ns)
        if self.bus.device.inbox or not self.board.quiet:
            self.device_side.tick(now_ns)
        elif self.player.waiting or not self.bridge.at_rest:
            self.device_side.coast(now_ns, 1, self.clock)
        else:
            self.device_side.coast(now_ns, self.clock.ticks_alone(due_ns), self.clock)
            return
        self.bridge.poll(now_ns)
        if self.player.waiting and self._looked_at != self.log.tracks.version:
            self._looked_at = self.log.tracks.version
            self.player.look(now_ns, self.log.tracks.now)

    def counters(self) -> dict[str, int]:
        """Everything that was counted on both sides and on the wire."""
        side, device = self.bridge, self.device_side
        counters = zip(DEVICE_COUNTERS, device.device.state.counters, strict=True)
        controller = {f"device.{name}": value for name, value in counters}
        wire = {f"wire.{name}": value for name, value in side.node.wire.counters.items()}
        effects = {f"medium.{name}": times for name, times in sorted(self.bus.effects().items())}
        sent = {
            "bridge.send_failed": side.send_failed,
            "bridge.tap_lost": side.tap.lost,
            "device.send_dropped": device.dropped,
            "device.tap_lost": device.tap.lost,
            "intruder.send_dropped": self.intruder.dropped,
        }
        totals = {
            "frames_sent": side.frames_sent,
            "frames_received": side.frames_received,
            "frames_lost": self.frames_lost,
            "ticks_missed": side.ticks_missed,
        }
        return {**totals, **controller, **wire, **effects, **sent}

    @property
    def frames_lost(self) -> int:
        """Frames that one side sent and the other knows it missed."""
        return self.device_side.device.state.counters[COUNT_LOST] + self.bridge.frames_lost

    # The script's executor

    def tell(self, now_ns: int, signals: Mapping[str, bool], text: str) -> None:
        """Faults under way, as signals and as a row."""
        self.log.put(now_ns, signals)
        self.log.record(EventRow(now_ns, text))

    def begin(self, number: int, active: Active, now_ns: int) -> None:
        """Hand a fault to the part that carries it out. Sensors, wearer and taps look at the board by themselves."""
        fault = active.step.fault
        self.log.record(fault_row(number, active, now_ns, begins=True))
        if fault in INTRUDER_FAULTS:
            self.intruder.begin(active)
        elif fault.startswith("bridge."):
            self.bridge.begin(active)
        elif fault in WIRE_FAULTS:
            self.bus.begin(active)
        elif fault.startswith("device."):
            self.device_side.begin(active)

    def end(self, number: int, active: Active, now_ns: int) -> None:
        """Tell the same part that the fault is over."""
        fault = active.step.fault
        self.log.record(fault_row(number, active, now_ns, begins=False))
        if fault in INTRUDER_FAULTS:
            return  # it looks at the board by itself
        if fault.startswith("bridge."):
            self.bridge.end(active)
        elif fault == "bus.stale_queue":
            self.intruder.release(self.bridge.tap.release())
        elif fault in WIRE_FAULTS:
            self.bus.end(active)
        elif fault.startswith("device.") or fault in PUSHING:
            self.device_side.end(active)
