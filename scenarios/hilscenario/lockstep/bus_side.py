"""The bus of a lockstep run: the bit-level medium with its three nodes, and the faults of its wire."""

from __future__ import annotations

import random
from collections.abc import Callable

from hilbridge.bus.model.events import Enqueued
from hilbridge.bus.model.faults import Corruption, Where, WireCut, WireFaults
from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.model.medium import Medium
from hilbridge.bus.simulated.network import Network, Station
from hilscenario.format.schema import BusPart
from hilscenario.lockstep.clock import WorldClock
from hilscenario.world.fault_board import FOREVER_NS, Active, FaultBoard

_NODES = ("bridge", "device", "intruder")
_SENT_BY_BRIDGE = (0x060, 0x061, 0x120, 0x300)
_DESTROYED = 40  # frames in a row: TEC + 8 each, so 32 of one transmitter make it bus-off at 256
_QUEUED = Enqueued.QUEUED


class BusSide:
    """The wire between `bridge`, `device` and `intruder`. `chance` draws the seed of each new set of wire faults."""

    def __init__(self, part: BusPart, seed: int, clock: WorldClock, board: FaultBoard, chance: random.Random) -> None:
        self._bit_error_rate = part.bit_error_rate
        self._clock, self._board, self._chance = clock, board, chance
        faults = WireFaults(seed=seed, bit_error_rate=part.bit_error_rate)
        self.network = Network(Medium(part.bitrate, faults=faults), clock)
        self.bridge, self.device, self.intruder = map(self.network.attach, _NODES)
        self._effects: dict[str, int] = {}
        self._forcing_off: Active | None = None

    def catch_up(self, now_ns: int) -> int:
        """Let everything happen on the wire that is due by now; when the next is."""
        medium = self.network.medium
        if medium.due_ns <= now_ns:
            self.network.pump()
        return medium.due_ns

    def put(self, station: Station, when_ns: int, can_id: int, data: bytes, dropped: Callable[[], None]) -> None:
        """Hand a frame to a controller chip, now or later. A full queue or a bus-off chip drops it: `dropped` is called."""
        if when_ns > self._clock.time_ns:
            self._clock.at(when_ns, lambda: self.put(station, when_ns, can_id, data, dropped))
        elif station.send(WireFrame(can_id, data)) is not _QUEUED:
            dropped()

    def begin(self, active: Active) -> None:
        """One of `vocabulary.WIRE_FAULTS`."""
        if active.step.fault == "bus.bus_off":
            self._forcing_off = active
        self._use_faults()

    def end(self, active: Active) -> None:
        """A cut ends. A bus-off has its own end: when the chip is off, see `bridge_is_off`."""
        if active.step.fault == "bus.cut":
            self._use_faults()

    def bridge_is_off(self) -> None:
        """The bridge has seen that its controller chip is bus-off: a fault that forced it has taken effect."""
        if self._forcing_off is not None:
            self._forcing_off.took_effect()
            self._forcing_off = None
            self._use_faults()

    def effects(self) -> dict[str, int]:
        """How often each kind of wire fault took effect, over the whole run."""
        self._keep_effects()
        return dict(self._effects)

    def _use_faults(self) -> None:
        """Give the wire all its faults under way, and keep count of what the old ones did."""
        self.network.pump()
        self._keep_effects()
        cut, off = self._board.get("bus.cut"), self._forcing_off
        destroyed = tuple(Corruption(can_id, Where.CRC, count=_DESTROYED) for can_id in _SENT_BY_BRIDGE)
        self.network.medium.use_faults(
            WireFaults(
                seed=self._chance.getrandbits(32),
                bit_error_rate=self._bit_error_rate,
                cuts=() if cut is None else (WireCut(frozenset(_NODES), self._clock.time_ns, FOREVER_NS),),
                corruptions=() if off is None else destroyed,
            )
        )

    def _keep_effects(self) -> None:
        effects = self.network.medium.fault_state.effects
        for name, times in effects.items():
            self._effects[name] = self._effects.get(name, 0) + times
        effects.clear()
