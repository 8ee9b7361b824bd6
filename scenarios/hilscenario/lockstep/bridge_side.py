"""The bridge of a lockstep run: the live node in a process that can hang, stall, die and come back."""

from __future__ import annotations

import random

from hilbridge.bus.model.error_frames import ErrorState
from hilbridge.bus.simulated.protocol import Arrival
from hilbridge.core.bridge import BridgeConfig
from hilbridge.limits import MS, TICK_NS
from hilbridge.records import Frame
from hilbridge.rows import EventRow, TickRow, belief_row, received_row, sent_row, with_truth
from hilbridge.runtime.account.judge import judged
from hilbridge.runtime.assemble import Parts, assemble_node
from hilbridge.runtime.node import Tick
from hilbridge.wire.keys import DEMO_KEY
from hilscenario.format.schema import Scenario
from hilscenario.lockstep.bus_side import BusSide
from hilscenario.lockstep.clock import WorldClock
from hilscenario.lockstep.run_log import RunLog
from hilscenario.lockstep.senses import Sight, VirtualSenses
from hilscenario.signals.bridge import absent_bridge, bridge_signals
from hilscenario.world.fault_board import Active, FaultBoard
from hilscenario.world.intent import make_predictor
from hilscenario.world.parts import parts_of
from hilscenario.world.replayed import make_assembler
from hilscenario.world.sensing import Body
from hilscenario.world.tap import Tap

TICK_PHASE_NS = 15 * MS  # 3 ms after a picture's features are ready, as a live tick that is locked to its camera
_BUS_OFF = ErrorState.BUS_OFF


class BridgeSide:
    """Senses -> node -> controller chip. `alive` is the process's."""

    def __init__(
        self,
        scenario: Scenario,
        clock: WorldClock,
        board: FaultBoard,
        bus: BusSide,
        log: RunLog,
        body: Body,
        parts: Parts | None = None,
    ) -> None:
        """`parts`: in place of the shipped bundle and the scenario's gate."""
        self._scenario, self._clock, self._board, self._bus, self._log = scenario, clock, board, bus, log
        self._body = body
        self._parts = parts or parts_of(scenario)
        self.tap = Tap("bridge", board, scenario.seed)
        self.senses = VirtualSenses(scenario, clock, board, body, lambda: self.alive and not self._hung)
        self.ticks: list[TickRow] = []
        self.alive = True
        self._hung = self._stalled = False
        self.ticks_missed = 0
        self.frames_sent = self.frames_received = 0
        self.send_failed = 0
        self._frames_lost_before = 0  # known to processes that died since
        self._nonces = random.Random(f"{scenario.seed}.nonces")
        self._chip: ErrorState | None = None
        self._boot()

    def _boot(self) -> None:
        """A new process: it has no memory of an earlier one."""
        self.predictor = make_predictor(self._scenario, own=self._parts.bundle)
        self.node = assemble_node(
            self._parts,
            DEMO_KEY,
            lambda: self._nonces.getrandbits(32),
            BridgeConfig(),
            lambda now_ns, text: self._log.record(EventRow(now_ns, text)),
            self.predictor,
        )
        record = self._log.record if self._log.is_recorded else None
        self.sight = self.senses.sight = Sight(make_assembler(self._scenario), record)
        self._inbox: list[Frame] = []

    def start(self) -> None:
        """Plan the first of everything."""
        self.senses.start()
        self._clock.at(TICK_PHASE_NS, self._tick)

    @property
    def frames_lost(self) -> int:
        """Frames of the device that the bridge knows it missed, over all its processes."""
        return self._frames_lost_before + self.node.wire.counters["LostFrames"]

    # The loop

    def _tick(self) -> None:
        now_ns = self._clock.time_ns
        self._clock.at(now_ns + TICK_NS, self._tick)
        if self.alive and not self._hung and not self._stalled:
            self._run_tick(now_ns)
            return
        self.ticks_missed += 1
        for fault in ("bridge.hang", "bridge.stall"):
            if self.alive and (active := self._board.get(fault)) is not None:
                active.took_effect()

    def _run_tick(self, now_ns: int) -> None:
        tick = self.node.tick(self.sight.take_vector(), self.sight.seen(), now_ns, self.sight.shaking)
        self._send(tick.frames)
        self._note(tick, now_ns)

    def poll(self, now_ns: int) -> None:
        """Once a millisecond: take in what has arrived, answer it, notice the state of the controller chip."""
        station = self._bus.bridge
        arrivals = station.drain() if station.inbox else ()
        if not self.alive:
            return
        if arrivals:
            self._inbox += map(_frame, arrivals)
        if self._hung or self._stalled:
            return
        if self._inbox:
            self._receive(now_ns)
        if stops := self.node.bridge.poll(now_ns):
            self._send(stops)
        chip = station.state
        if chip is not self._chip or chip is _BUS_OFF:
            self._notice(chip)

    @property
    def at_rest(self) -> bool:
        """`poll` has nothing to do until a frame comes or a planned call is made."""
        chip = self._bus.bridge.state
        waits = self._bus.bridge.inbox or self._inbox or self.node.bridge.is_stopping
        return not waits and chip is self._chip and chip is not _BUS_OFF

    def _receive(self, now_ns: int) -> None:
        self.frames_received += len(self._inbox)
        for frame in self._inbox:
            decoded, answers = self.node.receive(frame, frame.received_ns)
            if self._log.is_recorded:
                self._log.record(received_row(frame, None if decoded is None else decoded.name, now_ns))
            if answers:
                self._send(answers)
        self._inbox.clear()

    def _notice(self, chip: ErrorState) -> None:
        """The controller chip is in another state, or is bus-off."""
        if chip is _BUS_OFF:
            self._bus.bridge_is_off()
        if chip is not self._chip:
            self._chip = chip
            self.node.on_bus_state(chip)

    def _send(self, frames: list[Frame]) -> None:
        now_ns = self._clock.time_ns
        self.frames_sent += len(frames)
        for frame in frames:
            if self._log.is_recorded:
                self._log.record(sent_row(frame, None, now_ns))
            for when_ns, can_id, data in self.tap.send(frame.can_id, frame.data, now_ns):
                self._bus.put(self._bus.bridge, when_ns, can_id, data, self._not_sent)

    def _not_sent(self) -> None:
        self.send_failed += 1
        self.node.bridge.on_send_failed(bus_down=False)

    def _note(self, tick: Tick, now_ns: int) -> None:
        row = with_truth(tick.row, judged(self._body.calm.truth(now_ns), tick.row.verb))
        self.ticks.append(row)
        if tick.belief is not None and self._log.is_recorded:
            self._log.record(belief_row(tick.belief, now_ns, self.node.decider.gate_config.vocabulary))
        self._log.record(row)
        self._log.put(now_ns, bridge_signals(row))

    # Faults of the process

    def begin(self, active: Active) -> None:
        """bridge.hang, bridge.stall, bridge.kill, bridge.restart."""
        now_ns, fault = self._clock.time_ns, active.step.fault
        if fault == "bridge.hang":
            self._hung = True
            self._log.put(now_ns, absent_bridge("hung" if self.alive else "dead"))
        elif fault == "bridge.stall":
            self._stalled = True
            self._log.put(now_ns, absent_bridge("stalled" if self.alive else "dead"))
        else:
            active.took_effect(1 if self.alive else 0)
            self.alive = self._hung = self._stalled = False
            self._log.put(now_ns, absent_bridge("dead"))
            if fault == "bridge.restart":
                self._clock.at(now_ns + round(active["down_ms"] * MS), self._come_back)

    def end(self, active: Active) -> None:
        """A resumed process handles what has queued up, as an event loop does, then ticks at once, since it is late."""
        if active.step.fault not in ("bridge.hang", "bridge.stall") or not self.alive:
            return
        if active.step.fault == "bridge.hang":
            self._hung = False
        else:
            self._stalled = False
        if not self._hung and not self._stalled:
            now_ns = self._clock.time_ns
            self._bus.network.pump()
            self.poll(now_ns)
            self._run_tick(now_ns)

    def _come_back(self) -> None:
        if not self.alive:
            self.alive = True
            self._frames_lost_before = self.frames_lost
            self._boot()


def _frame(arrival: Arrival) -> Frame:
    """A bus arrival as the bridge's rooms see it; in virtual time both clocks are the same."""
    wire, stamp_ns = arrival.frame, arrival.stamp_ns
    return Frame(
        wire.can_id,
        wire.data,
        stamp_ns,
        stamp_ns,
        arrival.error,
        wire.is_fd,
        wire.is_extended,
        is_remote=wire.is_remote,
    )
