"""A third node on the bus, for faults that need one: it babbles, replays, forges, empties stale queues, sends STOP."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from firmware_sim import frames as layout
from hilbridge.bus.model.events import Enqueued
from hilbridge.bus.model.frames import WireFrame
from scenarios.world.fault_board import Active
from scenarios.world.forger import Forger
from scenarios.world.tap import Tap

if TYPE_CHECKING:
    from scenarios.lockstep.engine import Lockstep

MS = 1_000_000
_QUEUE = 2048  # more than a stale queue holds


class Intruder:
    """The third node. It listens always and sends only while one of its faults is under way."""

    def __init__(self, world: Lockstep, bridge_tap: Tap) -> None:
        self.world = world
        self.station = world.network.attach("intruder")
        world.network.medium.node(self.station.number).queue_limit = _QUEUE
        self._tap = bridge_tap
        self._forger = Forger(world.scenario.seed)
        self.dropped = 0

    def begin(self, active: Active) -> None:
        """bus.babble, bus.replay, bus.forge, bus.stop."""
        begin = {"bus.babble": self._babble, "bus.replay": self._replay, "bus.forge": self._forge}
        if active.step.fault == "bus.stop":
            for repeat in range(3):
                self.world.at(self.world.clock.time_ns + repeat * 10 * MS, lambda: self._stop(active))
        else:
            begin[active.step.fault](active)

    def release(self, queue: list[tuple[int, bytes]]) -> None:
        """Frames that waited in a dead queue go out together."""
        for can_id, data in queue:
            self._send(can_id, data)

    def _send(self, can_id: int, data: bytes) -> bool:
        queued = self.station.send(WireFrame(can_id, data)) is Enqueued.QUEUED
        self.dropped += not queued
        return queued

    def _under_way(self, active: Active) -> bool:
        return self.world.board.get(active.step.fault) is active

    def _stop(self, active: Active) -> None:
        active.took_effect(self._send(layout.STOP, b""))

    def _babble(self, active: Active) -> None:
        """Keeps enough frames waiting for the next millisecond."""
        if not self._under_way(active):
            return
        node = self.world.network.medium.node(self.station.number)
        wanted = max(1, round(active["per_s"] / 1000))
        self.world.network.pump()
        for _ in range(max(0, wanted - len(node.queue))):
            active.took_effect(self._send(round(active["can_id"]), b"\x55" * 8))
        self.world.at(self.world.clock.time_ns + MS, lambda: self._babble(active))

    def _replay(self, active: Active) -> None:
        """Everything that the bridge sent `past_s` ago, in its order and rhythm."""
        start_ns = self.world.clock.time_ns
        end_ns = min(active.until_ns, self.world.scenario.duration)
        past_ns = round(active["past_s"] * 1e9)
        for sent_ns, can_id, data in list(self._tap.sent):
            again_ns = sent_ns + past_ns
            if start_ns <= again_ns < end_ns:
                self.world.at(again_ns, self._repeater(active, can_id, data))

    def _repeater(self, active: Active, can_id: int, data: bytes) -> Callable[[], None]:
        return lambda: active.took_effect(self._send(can_id, data))

    def _send_both(self) -> bool:
        command, authorisation = self._forger.pair()
        return self._send(*command) & self._send(*authorisation)

    def _forge(self, active: Active) -> None:
        if not self._under_way(active):
            return
        while (arrival := self.station.receive()) is not None:
            if not arrival.error:
                self._forger.hear(arrival.frame.can_id, arrival.frame.data)
        active.took_effect(self._send_both())
        self.world.at(self.world.clock.time_ns + round(1e9 / active["per_s"]), lambda: self._forge(active))
