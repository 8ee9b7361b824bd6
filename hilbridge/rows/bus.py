"""Rows of what was on the bus, and of what it says of the device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from hilbridge.records import Frame
from hilbridge.rows.fields import Direction, Hex, Witness


@dataclass(frozen=True, slots=True)
class CanRow:
    """One CAN frame that the bridge sent or received."""

    topic: ClassVar[str] = "/can"

    time_ns: int
    direction: Direction
    can_id: int
    data: Hex
    """Payload, in hexadecimal."""
    name: str | None = None
    """The message's name where it was accepted; None for what was rejected, and for frames sent."""
    result: str | None = None
    """What the port did with a frame to send."""
    received_ns: int = 0
    """When the frame arrived; 0 for frames sent."""
    wall_ns: int = 0
    """The wall clock at arrival where the driver gives it; 0 otherwise."""
    is_error: bool = False
    is_extended: bool = False
    is_fd: bool = False
    is_remote: bool = False
    channel: str | None = None
    """Of a log that was imported, like the three below: which bus it was."""
    switches_rate: bool | None = None
    """An FD frame's bit rate switch."""
    sender_passive: bool | None = None
    """An FD frame's error state indicator."""
    asked_length: int | None = None
    """How many bytes a remote frame asks for."""


def received_row(frame: Frame, name: str | None, now_ns: int) -> CanRow:
    """A frame that the bridge took in; `name` is the message's where it was accepted."""
    return CanRow(
        now_ns,
        Direction.RX,
        frame.can_id,
        frame.data,
        name,
        None,
        frame.received_ns,
        frame.wall_ns,
        frame.is_error,
        frame.is_extended,
        frame.is_fd,
        frame.is_remote,
    )


def sent_row(frame: Frame, result: str | None, now_ns: int) -> CanRow:
    """A frame that the bridge handed to its port, and what the port did with it."""
    return CanRow(now_ns, Direction.TX, frame.can_id, frame.data, None, result)


SIGNAL_TOPICS = "/signal/"


@dataclass(frozen=True, slots=True)
class SignalRow:
    """A frame in words: the signals of one message, each message a topic of its own.

    `values`: every signal as a number; one with a value table has its word, too, under NAME_text. `direction` is beside them.
    """

    time_ns: int
    message: str
    direction: Direction
    values: dict[str, int | float | str]

    @property
    def topic(self) -> str:
        """`/signal/MESSAGE`."""
        return SIGNAL_TOPICS + self.message


@dataclass(frozen=True, slots=True)
class DeviceRow:
    """What the device is doing; states, reasons and verbs in the DBC's words.

    The device's own word has every field. By the bus, the fields of CTRL_STATUS and of CTRL_MEAS hold until the next.
    """

    topic: ClassVar[str] = "/device"

    time_ns: int
    witness: Witness
    state: str
    reason: str
    armed: bool
    verb: str
    """The verb being assisted, or `None`."""
    assist_zero: bool
    """Whether assist is exactly zero."""
    assist_nm: float | None = None
    gravity_nm: float | None = None
    """Support of the wearer's own arm."""
    follow_nm: float | None = None
    """Compensation of the device's own weight and friction."""
    angle_deg: float | None = None
    velocity_deg_s: float | None = None
    authority: float | None = None
    """Share of the assist that the wearer's opposition leaves, in percent."""
    session: int | None = None
    trips: int | None = None
    """Remembered trips of the last minute."""
    device_ms: int | None = None
    """The device's own clock."""
    accepted_ms: int | None = None
    """When the newest accepted command came, on the device's own clock."""
    accepted_counter: int | None = None
    accepted_hold: bool | None = None
    """Whether the newest accepted command counts as HOLD."""
