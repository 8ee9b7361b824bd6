"""A third node on a live bus, in the director's process: it babbles, replays, forges and sends STOP."""

from __future__ import annotations

import heapq
from collections import deque

from firmware_sim import frames as layout
from firmware_sim.attachment import Attachment, Spec
from hilbridge.limits import STOP_GAP_NS, STOP_REPEATS
from hilscenario.world.fault_board import Active
from hilscenario.world.forger import Forger

_REMEMBERED = 4096
_SENT_BY_BRIDGE = (0x060, 0x061, 0x120, 0x180, 0x182, 0x300)


class LiveIntruder:
    """Listens always and sends only while one of its faults is under way. Times are the monotonic clock's, in ns."""

    def __init__(self, spec: Spec, seed: int) -> None:
        self._bus = Attachment(spec)
        self._forger = Forger(seed)
        self._heard: deque[tuple[int, int, bytes]] = deque(maxlen=_REMEMBERED)
        self._plan: list[tuple[int, int, Active, tuple[tuple[int, bytes], ...]]] = []
        self._order = 0
        self._babbling: list[tuple[Active, int]] = []  # and when it last babbled
        self._forging: list[tuple[Active, int]] = []  # and when the next pair is due

    @property
    def dropped(self) -> int:
        """Frames that the bus did not take."""
        return self._bus.dropped

    def begin(self, active: Active, now_ns: int) -> None:
        """One of `vocabulary.INTRUDER_FAULTS`."""
        match active.step.fault:
            case "bus.stop":
                for repeat in range(STOP_REPEATS):
                    self._at(now_ns + repeat * STOP_GAP_NS, active, (layout.STOP, b""))
            case "bus.babble":
                self._babbling.append((active, now_ns))
            case "bus.forge" | "bridge.second":
                self._forging.append((active, now_ns))
            case "bus.replay":
                past_ns = round(active["past_s"] * 1e9)
                for heard_ns, can_id, data in self._heard:
                    if heard_ns + past_ns >= now_ns:
                        self._at(heard_ns + past_ns, active, (can_id, data))

    def end(self, active: Active) -> None:
        """Nothing more of this fault."""
        self._plan = [entry for entry in self._plan if entry[2] is not active or active.step.fault == "bus.stop"]
        heapq.heapify(self._plan)
        self._babbling = [entry for entry in self._babbling if entry[0] is not active]
        self._forging = [entry for entry in self._forging if entry[0] is not active]

    def poll(self, now_ns: int) -> None:
        """Receive what has arrived, send what is due."""
        for arrived_ns, frame in self._bus.read(now_ns):
            self._forger.hear(frame.can_id, frame.data)
            if frame.can_id in _SENT_BY_BRIDGE:
                self._heard.append((arrived_ns, frame.can_id, frame.data))
        while self._plan and self._plan[0][0] <= now_ns:
            _, _, active, frames = heapq.heappop(self._plan)
            self._send(active, frames, now_ns)
        self._babbling = [self._babble(active, last_ns, now_ns) for active, last_ns in self._babbling]
        self._forging = [self._forge(active, due_ns, now_ns) for active, due_ns in self._forging]

    def close(self) -> None:
        """Leave the bus."""
        self._bus.close()

    def _at(self, when_ns: int, active: Active, *frames: tuple[int, bytes]) -> None:
        self._order += 1
        heapq.heappush(self._plan, (when_ns, self._order, active, frames))

    def _send(self, active: Active, frames: tuple[tuple[int, bytes], ...], now_ns: int) -> None:
        before = self._bus.sent
        for can_id, data in frames:
            self._bus.send(can_id, data, now_ns)
        active.took_effect(self._bus.sent - before)

    def _babble(self, active: Active, last_ns: int, now_ns: int) -> tuple[Active, int]:
        wanted = int(active["per_s"] * (now_ns - last_ns) * 1e-9)
        if not wanted:
            return active, last_ns
        self._send(active, ((round(active["can_id"]), b"\x55" * 8),) * wanted, now_ns)
        return active, now_ns

    def _forge(self, active: Active, due_ns: int, now_ns: int) -> tuple[Active, int]:
        if now_ns < due_ns:
            return active, due_ns
        made = self._forger.pair() if active.step.fault == "bus.forge" else self._forger.second()
        self._send(active, tuple(made), now_ns)
        return active, max(now_ns, due_ns + round(1e9 / active["per_s"]))
