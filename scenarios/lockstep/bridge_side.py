"""The bridge within the lockstep engine: sensors, features, node, and a process that can hang, stall and die."""

from __future__ import annotations

import random
from collections.abc import Mapping
from typing import TYPE_CHECKING

from hilbridge.bus.model.error_frames import ErrorState
from hilbridge.bus.simulated.protocol import Arrival
from hilbridge.config import SensorsConfig
from hilbridge.core.bridge import Bridge, BridgeConfig
from hilbridge.intent.tremor import TremorGuard
from hilbridge.records import CameraFrame, FeatureVector, Frame, GazeSample
from hilbridge.rows import EventRow, GroundTruth, TickRow, received_row, sent_row, with_truth
from hilbridge.runtime.health import SensorSeen
from hilbridge.runtime.node import BridgeNode, Tick
from hilbridge.verbs import VERBS
from hilbridge.wire.codec import Codec
from hilbridge.wire.keys import DEMO_KEY
from hilbridge.wire.link import WireLink
from hilbridge.wire.secoc import Authenticator
from scenarios.signals.bridge import absent_bridge, bridge_signals
from scenarios.signals.tracks import Value
from scenarios.world.fault_board import Active
from scenarios.world.intent import bundle, gate_config, make_predictor
from scenarios.world.recorded import UnknownMind, make_assembler
from scenarios.world.sensing import CAMERA_PERIOD_NS, GAZE_PERIOD_NS, detected, edges
from scenarios.world.tap import Tap

if TYPE_CHECKING:
    from scenarios.lockstep.engine import Lockstep

MS = 1_000_000
TICK_PERIOD_NS = 40 * MS
# What a live run was seen to need: a picture is features 12 ms after its capture, and the tick follows 3 ms later.
VISION_NS = 12 * MS
TICK_PHASE_NS = 15 * MS
_PROBE_STEP = 16
_BUS_OFF = ErrorState.BUS_OFF
_BUS_CODES = {  # of BRIDGE_DIAG
    ErrorState.ACTIVE: 1,
    ErrorState.WARNING: 2,
    ErrorState.PASSIVE: 3,
    ErrorState.BUS_OFF: 4,
}
_LIMITS = SensorsConfig()
_CODEC = Codec()


class BridgeSide:
    """Sensors -> features -> node -> controller chip. `alive` and `running` are the process's."""

    def __init__(self, world: Lockstep, tap: Tap) -> None:
        self.world, self.tap = world, tap
        scenario = world.scenario
        self._camera, self._gaze, self._hands = edges(world.body, world.board, scenario.seed)
        self.ticks: list[TickRow] = []
        self.alive = True
        self._hung = self._stalled = False
        self.ticks_missed = 0
        self.frames_sent = self.frames_received = 0
        self.send_failed = 0
        self.frames_lost_before = 0  # known to processes that died since
        self._nonces = random.Random(f"{scenario.seed}.nonces")
        self._generation = 0
        self._chip: ErrorState | None = None
        self._boot()

    def _boot(self) -> None:
        """A process that starts: nothing of an earlier one is left."""
        scenario = self.world.scenario
        self.wire = WireLink(_CODEC)
        bridge = Bridge(
            self.wire,
            Authenticator(DEMO_KEY),
            lambda: self._nonces.getrandbits(32),
            BridgeConfig(),
            lambda: self.wire.counters,
        )
        self.predictor = make_predictor(scenario)
        self.node = BridgeNode(
            self.predictor,
            gate_config(scenario.gate),
            bridge,
            self.wire,
            bundle().bundle_id,
            TremorGuard(),
            lambda now_ns, text: self.world.record(EventRow(now_ns, text)),
        )
        self._assembler = make_assembler(scenario)
        self._frame: CameraFrame | None = None
        self._sample: GazeSample | None = None
        self._vector: FeatureVector | None = None
        self._camera_ns: int | None = None
        self._gaze_ns: int | None = None
        self._changed_ns: int | None = None
        self._probe = b""
        self._inbox: list[Frame] = []

    def start(self) -> None:
        """Plan the first of everything."""
        self.world.at(0, self._look)
        self.world.at(0, self._glance)
        self.world.at(TICK_PHASE_NS, self._tick)

    @property
    def frames_lost(self) -> int:
        """Frames of the device that the bridge knows it missed, over all its processes."""
        return self.frames_lost_before + self.wire.counters["LostFrames"]

    @property
    def _running(self) -> bool:
        return self.alive and not self._hung

    # Sensors

    def _look(self) -> None:
        now_ns = self.world.clock.time_ns
        self.world.at(now_ns + CAMERA_PERIOD_NS, self._look)
        delivered = self._camera.deliver(now_ns)
        if delivered is None:
            return
        arrives_ns, frame = delivered
        generation = self._generation
        self.world.at(arrives_ns + VISION_NS, lambda: self._see(frame, generation))

    def _see(self, frame: CameraFrame, generation: int) -> None:
        """The vision worker: hands, features."""
        if not self._running or generation != self._generation:
            return
        probe = frame.pixels[::_PROBE_STEP, ::_PROBE_STEP].tobytes()
        if probe != self._probe:
            self._probe, self._changed_ns = probe, frame.captured_ns
        self._camera_ns = frame.captured_ns
        hands = detected(self._hands, self.world.body, frame.captured_ns)
        sample, self._sample = self._sample, None
        self._vector = self._assembler.update(frame, sample, hands, frame.captured_ns)

    def _glance(self) -> None:
        now_ns = self.world.clock.time_ns
        self.world.at(now_ns + GAZE_PERIOD_NS, self._glance)
        delivered = self._gaze.deliver(now_ns)
        if delivered is not None:
            arrives_ns, sample = delivered
            generation = self._generation
            self.world.at(arrives_ns, lambda: self._take_gaze(sample, generation))

    def _take_gaze(self, sample: GazeSample, generation: int) -> None:
        if self._running and generation == self._generation:
            self._sample, self._gaze_ns = sample, sample.captured_ns

    def _seen(self) -> tuple[SensorSeen, ...]:
        return (
            SensorSeen(
                "camera",
                True,
                self._camera_ns,
                self._changed_ns,
                _LIMITS.camera_timeout_ms * MS,
                _LIMITS.freeze_ms * MS,
            ),
            SensorSeen("gaze", True, self._gaze_ns, None, _LIMITS.gaze_timeout_ms * MS),
        )

    # The loop

    def _tick(self) -> None:
        world = self.world
        now_ns = world.clock.time_ns
        world.at(now_ns + TICK_PERIOD_NS, self._tick)
        if not self._running or self._stalled:
            self.ticks_missed += 1
            for fault in ("bridge.hang", "bridge.stall"):
                if self.alive and (active := world.board.get(fault)) is not None:
                    active.took_effect()
            return
        self._run_tick(now_ns)

    def _run_tick(self, now_ns: int) -> None:
        vector, self._vector = self._vector, None
        tick = self.node.tick(vector, self._seen(), now_ns)
        self._send(tick.frames)
        self._note(tick, now_ns)

    def poll(self, now_ns: int) -> None:
        """Once a millisecond: take in what has arrived, answer it, notice the state of the controller chip."""
        station = self.world.bridge_station
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

    def _receive(self, now_ns: int) -> None:
        self.frames_received += len(self._inbox)
        for frame in self._inbox:
            decoded, answers = self.node.receive(frame, frame.received_ns)
            if self.world.is_recorded:
                self.world.record(received_row(frame, None if decoded is None else decoded.name, now_ns))
            if answers:
                self._send(answers)
        self._inbox.clear()

    def _notice(self, chip: ErrorState) -> None:
        """The controller chip is in another state, or is bus-off."""
        if chip is _BUS_OFF:
            self.world.bridge_is_off()
        if chip is not self._chip:
            self._chip = chip
            self.node.bridge.on_bus_state(_BUS_CODES.get(chip, 0), chip is _BUS_OFF)
            if chip is _BUS_OFF:
                self.node.bridge.on_send_failed(bus_down=True)

    def _send(self, frames: list[Frame]) -> None:
        now_ns = self.world.clock.time_ns
        self.frames_sent += len(frames)
        for frame in frames:
            if self.world.is_recorded:
                self.world.record(sent_row(frame, None, now_ns))
            for when_ns, can_id, data in self.tap.send(frame.can_id, frame.data, now_ns):
                self.world.put_on_bus(self.world.bridge_station, when_ns, can_id, data, self._not_sent)

    def _not_sent(self) -> None:
        self.send_failed += 1
        self.node.bridge.on_send_failed(bus_down=False)

    def _note(self, tick: Tick, now_ns: int) -> None:
        truth = self.world.body.calm.truth(now_ns)
        verb = tick.decision.verb_index
        intended = None if truth.intended is None else VERBS[truth.intended]
        known = GroundTruth(intended, None if verb is None else truth.is_right(verb))
        row = with_truth(tick.row, None if isinstance(truth, UnknownMind) else known)
        self.ticks.append(row)
        self.world.record(row)
        self._put(bridge_signals(row))

    # Faults of the process

    def begin(self, active: Active) -> None:
        """bridge.hang, bridge.stall, bridge.kill, bridge.restart."""
        fault = active.step.fault
        if fault == "bridge.hang":
            self._hung = True
            self._put(absent_bridge("hung" if self.alive else "dead"))
        elif fault == "bridge.stall":
            self._stalled = True
            self._put(absent_bridge("stalled" if self.alive else "dead"))
        else:
            active.took_effect(1 if self.alive else 0)
            self.alive = self._hung = self._stalled = False
            self._generation += 1
            self._put(absent_bridge("dead"))
            if fault == "bridge.restart":
                self.world.at(self.world.clock.time_ns + round(active["down_ms"] * MS), self._come_back)

    def end(self, active: Active) -> None:
        """A process that goes on takes in what has piled up, as an event loop does, then ticks at once: it is late."""
        if active.step.fault not in ("bridge.hang", "bridge.stall") or not self.alive:
            return
        if active.step.fault == "bridge.hang":
            self._hung = False
        else:
            self._stalled = False
        if not self._hung and not self._stalled:
            now_ns = self.world.clock.time_ns
            self.world.network.pump()
            self.poll(now_ns)
            self._run_tick(now_ns)

    def _come_back(self) -> None:
        if not self.alive:
            self.alive = True
            self.frames_lost_before += self.wire.counters["LostFrames"]
            self._generation += 1
            self._boot()

    def _put(self, signals: Mapping[str, Value]) -> None:
        time_ms = self.world.clock.time_ns / MS
        for name, value in signals.items():
            self.world.tracks.put(time_ms, name, value)


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
