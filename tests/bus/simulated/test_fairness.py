"""Who comes first at a simulated bus whose computer cannot keep up."""

from __future__ import annotations

import socket
import uuid

from hilbridge.bus.model.medium import Medium
from hilbridge.bus.simulated.handshake import Client
from hilbridge.bus.simulated.protocol import Kind, Record, RecordWriter, claim, in_parts
from hilbridge.bus.simulated.server import BusServer


def test_who_floods_comes_after_who_does_not_also_when_a_share_is_forgiven() -> None:
    server = BusServer(name := f"test-{uuid.uuid4()}", claim(name), Medium(), clock=lambda: 0)
    ends = socket.socketpair()
    one, other = (Client(n, 0, end, RecordWriter(end), 0, 0, transmit=end) for n, end in enumerate(ends))
    server._by_node.update({0: one, 1: other})
    one.spent_ns, other.spent_ns = 1_000_000_000, 1_000_000
    server._sweep(0)
    assert one.spent_ns > other.spent_ns > 0
    for _ in range(40):
        server._sweep(0)
    assert one.spent_ns == 0  # nobody owes for ever
    server._reception.close()


def test_a_long_answer_is_the_same_records_whoever_packs_them() -> None:
    for length in (0, 1, 63, 64, 65, 128, 1000):
        raw = bytes(range(256)) * 4
        parts = [raw[:length][start : start + 64] for start in range(0, max(1, length), 64)]
        records = [Record(Kind.ANSWER, extra=int(part is not parts[-1]), data=part).pack() for part in parts]
        assert in_parts(Kind.ANSWER, raw[:length]) == b"".join(records)
