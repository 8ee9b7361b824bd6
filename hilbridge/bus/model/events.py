"""What the medium tells: each event carries the bus time at which it happened."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

from hilbridge.bus.model.error_frames import ErrorKind, ErrorState
from hilbridge.bus.model.frames import WireFrame


class Enqueued(StrEnum):
    """What became of a frame handed to a node's transmit queue, or why it was taken out again."""

    QUEUED = "queued"
    FULL = "transmit queue full"
    BUS_OFF = "bus off"
    LISTEN_ONLY = "listen only"
    BAD_FRAME = "no such frame"


class Delivered(NamedTuple):
    """A frame arrived at `receivers`. `at_ns` is the end of its end of frame; `tag` is what the sender gave with it.

    `sent` is False where the sender saw an error that these receivers did not: it will send again (ISO 11898-1 allows
    that at the last bit of end of frame), and they get the frame twice.
    """

    at_ns: int
    frame: WireFrame
    sender: int
    tag: int
    receivers: tuple[int, ...]
    sent: bool = True


class BusError(NamedTuple):
    """An attempt to send failed, or one receiver missed it. `errors` has the first error that each node saw."""

    at_ns: int
    frame: WireFrame
    sender: int
    errors: dict[int, ErrorKind]


class StateChanged(NamedTuple):
    """A node's error confinement state is another one now."""

    at_ns: int
    node: int
    state: ErrorState
    tec: int
    rec: int


class FrameLost(NamedTuple):
    """A queued frame was thrown away: its node went bus-off."""

    at_ns: int
    node: int
    tag: int
    reason: Enqueued


Event = Delivered | BusError | StateChanged | FrameLost
