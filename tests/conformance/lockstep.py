"""A line in virtual time: the simulated device steps along with whoever waits for its frames."""

from __future__ import annotations

import random
from collections import deque

from firmware_sim.controllers import power_on
from firmware_sim.device import Device
from firmware_sim.e2e import protect
from firmware_sim.keys import WRONG
from firmware_sim.memory import Received
from firmware_sim.secoc import DEMO_KEY
from hilbridge.conformance.tester import ByHand, Setting
from hilbridge.limits import MS
from hilbridge.records import Frame
from hilbridge.wire.codec import Codec
from hilbridge.wire.secoc import Authenticator

_START_MS = 50_000


class LockstepLine:
    """One device, one tester. `twice` has identifiers that the device answers with twice, `late_ms` by how much too late."""

    def __init__(self, controller: str = "python", wearer: str = "sway", *, seed: int = 1) -> None:
        self.random = random.Random(seed)
        self.device = Device(power_on(controller, DEMO_KEY, self.random.getrandbits(32)), wearer)
        self.twice: set[int] = set()
        self.late_ms: dict[int, int] = {}
        self._counters: dict[int, int] = {}
        self._late: list[tuple[int, Frame]] = []
        self._now_ns = _START_MS * MS
        self._to_device: list[Received] = []
        self._to_tester: deque[Frame] = deque()

    def now_ns(self) -> int:
        return self._now_ns

    def send(self, frame: Frame) -> None:
        plain = not (frame.is_remote or frame.is_extended or frame.is_fd)
        self._to_device.append(Received(frame.can_id, frame.data, plain))

    def receive(self, until_ns: int) -> Frame | None:
        while not self._to_tester:
            tick_ns = (self._now_ns // MS + 1) * MS
            if tick_ns > until_ns:
                self._now_ns = max(self._now_ns, until_ns)
                return None
            self._now_ns = tick_ns
            self._tick()
        return self._to_tester.popleft()

    def _tick(self) -> None:
        frames, self._to_device = tuple(self._to_device), []
        for can_id, data in self.device.tick(frames, self.random.getrandbits(32)):
            copies = 2 if can_id in self.twice else 1
            for _ in range(copies):
                if can_id in self.twice:  # each copy a frame of its own
                    counter = self._counters[can_id] = (self._counters.get(can_id, 0) + 1) & 0xFF
                    data = protect(can_id, data, counter)
                self._late.append((self._now_ns + self.late_ms.get(can_id, 0) * MS, Frame(can_id, data)))
        due = [frame for at_ns, frame in self._late if at_ns <= self._now_ns]
        self._late = [one for one in self._late if one[0] > self._now_ns]
        self._to_tester.extend(frame._replace(received_ns=self._now_ns) for frame in due)

    def press(self) -> None:
        self.device.local_clear = True


def a_tester(line: LockstepLine, *, phases: int = 2, hand: bool = True, wrong_key: bool = False) -> ByHand:
    key = WRONG if wrong_key else DEMO_KEY
    setting = Setting(Authenticator(key), random.Random(2), 2.0, phases, line.press if hand else None)
    return ByHand(line, Codec(), setting)
