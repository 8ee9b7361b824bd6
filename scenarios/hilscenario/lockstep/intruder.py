"""A third node on the bus, for faults that need one: it babbles, replays, forges, empties stale queues, sends STOP."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from firmware_sim import frames as layout
from hilbridge.bus.model.events import Enqueued
from hilbridge.bus.model.frames import WireFrame
from hilbridge.limits import MS, STOP_GAP_NS, STOP_REPEATS
from hilscenario.format.schema import Scenario
from hilscenario.lockstep.bus_side import BusSide
from hilscenario.lockstep.clock import WorldClock
from hilscenario.world.fault_board import Active, FaultBoard
from hilscenario.world.forger import Forger
from hilscenario.world.tap import Tap

_QUEUE_LIMIT = 2048  # more than a stale queue holds


class Intruder:
    """The third node. It listens always and sends only while one of its faults is under way."""

    def __init__(self, scenario: Scenario, clock: WorldClock, board: FaultBoard, bus: BusSide, bridge_tap: Tap) -> None:
        """`bridge_tap` remembers what the bridge has sent, for replays."""
        self._clock, self._board, self._network = clock, board, bus.network
        self._station, self._bridge_tap = bus.intruder, bridge_tap
        self._node = bus.network.medium.node(bus.intruder.number)
        self._node.queue_limit = _QUEUE_LIMIT
        self._end_ns = scenario.duration
        self._forger = Forger(scenario.seed)
        self.dropped = 0

    def begin(self, active: Active) -> None:
        """One of `vocabulary.INTRUDER_FAULTS`."""
        match active.step.fault:
            case "bus.babble":
                self._babble(active)
            case "bus.replay":
                self._replay(active)
            case "bus.forge":
                self._forge(active, self._forger.pair)
            case "bridge.second":
                self._forge(active, self._forger.second)
            case "bus.stop":
                for repeat in range(STOP_REPEATS):
                    self._at(self._clock.time_ns + repeat * STOP_GAP_NS, active, layout.STOP, b"")

    def release(self, queue: list[tuple[int, bytes]]) -> None:
        """Frames that waited in a dead queue go out together."""
        for can_id, data in queue:
            self._send(can_id, data)

    def _send(self, can_id: int, data: bytes) -> bool:
        queued = self._station.send(WireFrame(can_id, data)) is Enqueued.QUEUED
        self.dropped += not queued
        return queued

    def _at(self, when_ns: int, active: Active, can_id: int, data: bytes) -> None:
        self._clock.at(when_ns, lambda: active.took_effect(self._send(can_id, data)))

    def _under_way(self, active: Active) -> bool:
        return self._board.get(active.step.fault) is active

    def _babble(self, active: Active) -> None:
        """Keep enough frames waiting for the next millisecond."""
        if not self._under_way(active):
            return
        wanted = max(1, round(active["per_s"] / 1000))
        self._network.pump()
        for _ in range(max(0, wanted - len(self._node.queue))):
            active.took_effect(self._send(round(active["can_id"]), b"\x55" * 8))
        self._clock.at(self._clock.time_ns + MS, partial(self._babble, active))

    def _replay(self, active: Active) -> None:
        """Send everything that the bridge sent `past_s` ago, in its order and rhythm."""
        end_ns = min(active.until_ns, self._end_ns)
        past_ns = round(active["past_s"] * 1e9)
        for sent_ns, can_id, data in list(self._bridge_tap.sent):
            if self._clock.time_ns <= sent_ns + past_ns < end_ns:
                self._at(sent_ns + past_ns, active, can_id, data)

    def _forge(self, active: Active, make: Callable[[], list[tuple[int, bytes]]]) -> None:
        """Send made-up frames, now and at the fault's rate."""
        if not self._under_way(active):
            return
        while (arrival := self._station.receive()) is not None:
            if not arrival.error:
                self._forger.hear(arrival.frame.can_id, arrival.frame.data)
        sent = [self._send(*frame) for frame in make()]
        active.took_effect(all(sent))
        self._clock.at(self._clock.time_ns + round(1e9 / active["per_s"]), partial(self._forge, active, make))
