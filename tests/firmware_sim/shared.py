"""A bus and a clock of the tests' own, and a node on them."""

from __future__ import annotations

import io

from firmware_sim.attachment import Arrival
from firmware_sim.device import Device
from firmware_sim.memory import ControllerState
from firmware_sim.node import Node
from firmware_sim.secoc import DEMO_KEY
from hilbridge.limits import MS


class FakeBus:
    """Takes what the node sends and gives what a test wants to arrive."""

    def __init__(self) -> None:
        self.arrivals: list[Arrival] = []
        self.log: list[tuple[int, bytes]] = []
        self.stamps: list[int] = []
        self.reads: list[int] = []
        self.received = self.sent = self.dropped = self.link_errors = 0
        self.bus_off = False

    def read(self, now_ns: int) -> list[Arrival]:
        self.reads.append(now_ns)
        taken = [arrival for arrival in self.arrivals if arrival.arrived_ns <= now_ns]
        self.arrivals = [arrival for arrival in self.arrivals if arrival.arrived_ns > now_ns]
        return taken

    def send(self, can_id: int, data: bytes, now_ns: int) -> None:
        assert len(self.log) < 5000, "ticks without end"
        self.log.append((can_id, data))
        self.stamps.append(now_ns)


class Clock:
    """Stands in for the node's clock: sleeping moves it, and `jumps` stall it."""

    def __init__(self) -> None:
        self.now_ns = 5_000_000_000
        self.jumps: dict[int, int] = {}
        self.looks = 0
        self.slept_ns = 0

    def monotonic_ns(self) -> int:
        self.looks += 1
        assert self.looks < 10_000, "a loop that never sleeps"
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        self.looks = 0
        self.slept_ns += round(seconds * 1e9)
        assert self.slept_ns < 10_000 * MS, "a loop that never ends"
        self.now_ns += round(seconds * 1e9)
        for at_ms in [at_ms for at_ms in self.jumps if self.now_ns >= 5_000_000_000 + at_ms * MS]:
            self.now_ns += self.jumps.pop(at_ms) * MS


def make(log: io.StringIO | None = None, log_cycle_ms: int = 20) -> tuple[Node, FakeBus]:
    bus = FakeBus()
    return Node(Device(ControllerState(DEMO_KEY, 1)), bus, log, log_cycle_ms), bus  # type: ignore[arg-type]
