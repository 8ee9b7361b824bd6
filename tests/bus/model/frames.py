"""What the tests of the model share."""

from __future__ import annotations

from hilbridge.bus.model.bits import frame_length
from hilbridge.bus.model.events import Delivered, Event
from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.model.medium import Medium

BIT_NS = 2_000  # 500 kbit/s


SECOND_NS = 1_000_000_000


def run_out(medium: Medium, limit_ns: int = 10 * SECOND_NS) -> list[Event]:
    return medium.advance(limit_ns)


def delivered(events: list[Event]) -> list[Delivered]:
    return [event for event in events if isinstance(event, Delivered)]


def bits(frame: WireFrame) -> int:
    return frame_length(frame).nominal_bits
