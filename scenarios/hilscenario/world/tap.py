"""Faults between a node and its controller chip, where neither CAN's CRC nor its acknowledgement sees them.

A tap takes every frame a node sends and says which frames go out, and when. Pure but for its seeded chance.
"""

from __future__ import annotations

import random
from collections import deque

from hilscenario.world.fault_board import Active, FaultBoard

# What leaves a tap: (when, identifier, payload).
Outgoing = tuple[int, int, bytes]
_KINDS = ("bus.drop", "bus.corrupt", "bus.stale_queue", "bus.reorder", "bus.delay", "bus.duplicate")
_REMEMBERED = 4096


class Tap:
    """One node's way out. `side` is `bridge` or `device`; a stale queue is the bridge's only."""

    def __init__(self, side: str, board: FaultBoard, seed: int) -> None:
        self.side = side
        self.sent: deque[Outgoing] = deque(maxlen=_REMEMBERED)  # for replays
        self._board = board
        self._random = random.Random(f"{seed}.tap.{side}")
        self._held: Outgoing | None = None
        self._queue: list[tuple[int, bytes]] = []
        self.lost = 0  # frames that never went out: dropped, or too many for a stale queue

    def send(self, can_id: int, data: bytes, now_ns: int) -> list[Outgoing]:
        """What goes out for a frame handed over now."""
        self.sent.append((now_ns, can_id, data))
        if self._board.quiet and self._held is None:
            return [(now_ns, can_id, data)]
        drop, corrupt, stale, reorder, delay, duplicate = map(self._board.get, _KINDS)
        if drop is not None and self._hits(drop, can_id):
            self.lost += 1
            return []
        if corrupt is not None and self._hits(corrupt, can_id):
            data = self._flipped(data, round(corrupt["bits"]))
        if stale is not None and self.side == "bridge":
            if len(self._queue) < stale["frames"]:
                self._queue.append((can_id, data))
                stale.took_effect()
            else:
                self.lost += 1
            return []
        when_ns = now_ns
        if delay is not None and self._hits(delay, can_id):
            when_ns += round(delay["delay_ms"] * 1e6)
        outgoing = [(when_ns, can_id, data)]
        if duplicate is not None and self._hits(duplicate, can_id):
            outgoing.append((when_ns, can_id, data))
        if self._held is not None:
            held, self._held = self._held, None
            return [*outgoing, (now_ns, held[1], held[2])]
        if reorder is not None and self._hits(reorder, can_id):
            self._held = outgoing[0]
            return outgoing[1:]
        return outgoing

    def release(self) -> list[tuple[int, bytes]]:
        """The queue of a stale_queue that ends."""
        queue, self._queue = self._queue, []
        return queue

    def _hits(self, active: Active, can_id: int) -> bool:
        wanted = active["can_id"]
        if wanted >= 0 and wanted != can_id:
            return False
        if "share" in active.step.options and self._random.random() >= active["share"]:
            return False
        active.took_effect()
        return True

    def _flipped(self, data: bytes, bits: int) -> bytes:
        if not data:
            return data
        number = int.from_bytes(data, "little")
        for bit in self._random.sample(range(8 * len(data)), min(bits, 8 * len(data))):
            number ^= 1 << bit
        return number.to_bytes(len(data), "little")
