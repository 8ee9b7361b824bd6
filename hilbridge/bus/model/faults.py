"""Faults of a simulated bus as one seeded options record; every fault counts that it took effect."""

from __future__ import annotations

import math
import random
from collections import Counter
from dataclasses import dataclass
from enum import StrEnum

from hilbridge.bus.model.bits import EncodedFrame

FOREVER_NS = 1 << 62


class Where(StrEnum):
    """Bits of a frame by name, for a corruption that need not know the frame's length."""

    IDENTIFIER = "identifier"
    DATA = "data"
    CRC = "crc"
    CRC_DELIMITER = "crc_delimiter"
    ACK = "ack"
    ACK_DELIMITER = "ack_delimiter"
    EOF = "eof"
    LAST_EOF = "last_eof"


@dataclass(frozen=True, slots=True)
class Corruption:
    """Flip one bit of the next `count` frames with `can_id` (None: any) that start within the time.

    `bit` is a name or an index into the stuffed frame (negative from its end). `receiver` None: the whole bus sees it,
    the sender too; otherwise only the node of that name does.
    """

    can_id: int | None
    bit: Where | int = Where.DATA
    receiver: str | None = None
    count: int = 1
    from_ns: int = 0
    until_ns: int = FOREVER_NS


@dataclass(frozen=True, slots=True)
class Babble:
    """A node that fills the bus with frames of one identifier, back to back."""

    node: str
    can_id: int = 0
    data: bytes = b"\x55" * 8
    from_ns: int = 0
    until_ns: int = FOREVER_NS


@dataclass(frozen=True, slots=True)
class WireCut:
    """Nodes cut off, each alone, from the first frame that starts within the time."""

    nodes: frozenset[str]
    from_ns: int = 0
    until_ns: int = FOREVER_NS


@dataclass(frozen=True, slots=True)
class QueueStall:
    """A node whose controller takes no new frame from its transmit queue: frames wait and come late."""

    node: str
    from_ns: int = 0
    until_ns: int = FOREVER_NS


@dataclass(frozen=True, slots=True)
class WireFaults:
    """Everything that can go wrong on the wire. The same seed and the same frames give the same run.

    `bit_error_rate` is per bit of a frame on the wire; `local_share` of such errors is seen by one receiver only, the
    rest by everybody. Nodes of `no_ack` receive but never acknowledge. Raises ValueError for rates outside 0..1.
    """

    seed: int = 0
    bit_error_rate: float = 0.0
    local_share: float = 0.0
    corruptions: tuple[Corruption, ...] = ()
    babbles: tuple[Babble, ...] = ()
    cuts: tuple[WireCut, ...] = ()
    stalls: tuple[QueueStall, ...] = ()
    no_ack: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        for name in ("bit_error_rate", "local_share"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name} must lie within 0..1, not {getattr(self, name)}")


def flipped_bit(bit: Where | int, frame: EncodedFrame) -> int:
    """The index of a named bit in an encoded frame; a number is taken as it is, within the frame."""
    if not isinstance(bit, Where):
        return bit % len(frame.bits)
    return {
        Where.IDENTIFIER: 6,
        Where.DATA: (frame.arbitration_end + frame.checksum_start) // 2,
        Where.CRC: (frame.checksum_start + frame.crc_delimiter) // 2,
        Where.CRC_DELIMITER: frame.crc_delimiter,
        Where.ACK: frame.ack_slot,
        Where.ACK_DELIMITER: frame.ack_slot + 1,
        Where.EOF: frame.ack_slot + 4,
        Where.LAST_EOF: len(frame.bits) - 1,
    }[bit]


class FaultState:
    """The running part: random numbers drawn so far, corruptions left, effects counted by name of the fault."""

    def __init__(self, faults: WireFaults, since_ns: int = 0) -> None:
        """`since_ns`: when the faults came; none of them reaches into the time before."""
        self.faults = faults
        self._since_ns = since_ns
        self.effects: Counter[str] = Counter()
        self.any_corruption = bool(faults.corruptions)
        self._left = [corruption.count for corruption in faults.corruptions]
        self._random = random.Random(faults.seed)
        self._bits_until_error = self._draw()

    def _draw(self) -> int:
        """Bits before the next error: geometric, so that a frame without error costs one comparison."""
        rate = self.faults.bit_error_rate
        if rate <= 0.0:
            return FOREVER_NS
        if rate >= 1.0:
            return 0
        return int(math.log1p(-self._random.random()) / math.log1p(-rate))

    def random_error(self, bits: int) -> int | None:
        """Index of the bit hit among the next `bits` on the wire, or None."""
        if self._bits_until_error >= bits:
            self._bits_until_error -= bits
            return None
        index, self._bits_until_error = self._bits_until_error, self._draw()
        self.effects["bit_error"] += 1
        return index

    def random_receiver(self, receivers: list[int]) -> int | None:
        """The one receiver that alone sees a random error, or None when everybody does."""
        if not receivers or self._random.random() >= self.faults.local_share:
            return None
        return self._random.choice(receivers)

    def corruption(self, can_id: int, start_ns: int, receivers: set[str]) -> Corruption | None:
        """The targeted corruption that hits a frame starting now, heard by these receivers, if any."""
        for index, fault in enumerate(self.faults.corruptions):
            if self._left[index] > 0 and fault.can_id in (None, can_id) and fault.from_ns <= start_ns < fault.until_ns:
                self._left[index] -= 1
                self.effects["corruption"] += 1
                self.any_corruption = any(self._left)
                return fault
        return None

    def stalled_until(self, node: str, at_ns: int) -> int:
        """When the node's queue moves again; `at_ns` itself where it is not stalled."""
        ready_ns = at_ns
        for stall in self.faults.stalls:
            if stall.node == node and stall.from_ns <= ready_ns < stall.until_ns:
                ready_ns = stall.until_ns
                self.effects["stall"] += 1
        return ready_ns

    def next_babble(self, node: str, from_ns: int) -> tuple[int, Babble] | None:
        """What the node babbles next, from that time on, and when."""
        from_ns = max(from_ns, self._since_ns)
        times = [
            (max(fault.from_ns, from_ns), fault)
            for fault in self.faults.babbles
            if fault.node == node and from_ns < fault.until_ns
        ]
        return min(times, key=lambda item: item[0], default=None)

    def is_cut(self, node: str, at_ns: int) -> bool:
        """Whether the node is off the wire at that time."""
        return any(node in cut.nodes and cut.from_ns <= at_ns < cut.until_ns for cut in self.faults.cuts)
