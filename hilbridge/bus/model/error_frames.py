"""Error frames as Linux writes them (linux/can/error.h): what the controller tells of its bus."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

CLASS_TX_TIMEOUT = 0x001
CLASS_LOST_ARBITRATION = 0x002
CLASS_CONTROLLER = 0x004
CLASS_PROTOCOL = 0x008
CLASS_NO_ACK = 0x020
CLASS_BUS_OFF = 0x040
CLASS_BUS_ERROR = 0x080
CLASS_RESTARTED = 0x100
CLASS_COUNTERS = 0x200

PROTOCOL_BIT, PROTOCOL_FORM, PROTOCOL_STUFF, PROTOCOL_SENDING = 0x01, 0x02, 0x04, 0x80

CONTROLLER_RX_OVERFLOW = 0x01
CONTROLLER_TX_OVERFLOW = 0x02
CONTROLLER_RX_WARNING = 0x04
CONTROLLER_TX_WARNING = 0x08
CONTROLLER_RX_PASSIVE = 0x10
CONTROLLER_TX_PASSIVE = 0x20
CONTROLLER_ACTIVE = 0x40


class ErrorState(StrEnum):
    """Error confinement state of ISO 11898-1, with the customary warning at 96."""

    ACTIVE = "error-active"
    WARNING = "error-warning"
    PASSIVE = "error-passive"
    BUS_OFF = "bus-off"
    UNKNOWN = "unknown"


class ErrorKind(StrEnum):
    """The five errors of ISO 11898-1."""

    BIT = "bit"
    STUFF = "stuff"
    CRC = "crc"
    FORM = "form"
    ACK = "ack"


class ErrorEvent(NamedTuple):
    """What one error frame says; None where it says nothing of it."""

    controller: ErrorState | None
    tx_errors: int | None
    rx_errors: int | None
    no_ack: bool
    overflow: bool


def read_error_frame(can_id: int, data: bytes) -> ErrorEvent:
    """Read an error frame's classes (`can_id` without the error flag) and eight data bytes. Never raises."""
    padded = data.ljust(8, b"\0")
    control = padded[1] if can_id & CLASS_CONTROLLER else 0
    controller: ErrorState | None = None
    if can_id & CLASS_BUS_OFF:
        controller = ErrorState.BUS_OFF
    elif control & (CONTROLLER_RX_PASSIVE | CONTROLLER_TX_PASSIVE):
        controller = ErrorState.PASSIVE
    elif control & (CONTROLLER_RX_WARNING | CONTROLLER_TX_WARNING):
        controller = ErrorState.WARNING
    elif control & CONTROLLER_ACTIVE or can_id & CLASS_RESTARTED:
        controller = ErrorState.ACTIVE
    # Kernels before 5.20 fill the counters without setting the class; then a state change carries them too.
    counted = bool(can_id & CLASS_COUNTERS) or (bool(can_id & CLASS_CONTROLLER) and any(padded[6:8]))
    return ErrorEvent(
        controller,
        padded[6] if counted else None,
        padded[7] if counted else None,
        bool(can_id & CLASS_NO_ACK),
        bool(control & (CONTROLLER_RX_OVERFLOW | CONTROLLER_TX_OVERFLOW)),
    )


def write_error_frame(
    state: ErrorState | None,
    tx_errors: int,
    rx_errors: int,
    *,
    kind: ErrorKind | None = None,
    sending: bool = False,
) -> tuple[int, bytes]:
    """An error frame's classes and data, so that the simulated bus tells the same things in the same words as Linux.

    `state` is the controller's new state (None: unchanged), `kind` a failed attempt seen as sender or receiver.
    """
    classes, control, protocol = CLASS_COUNTERS, 0, 0
    if state is ErrorState.BUS_OFF:
        classes |= CLASS_BUS_OFF
    elif state is not None:
        classes |= CLASS_CONTROLLER
        control = {
            ErrorState.PASSIVE: CONTROLLER_TX_PASSIVE if tx_errors > 127 else CONTROLLER_RX_PASSIVE,
            ErrorState.WARNING: CONTROLLER_TX_WARNING if tx_errors >= 96 else CONTROLLER_RX_WARNING,
        }.get(state, CONTROLLER_ACTIVE)
    if kind is ErrorKind.ACK:
        classes |= CLASS_NO_ACK | CLASS_BUS_ERROR
    elif kind is not None:
        classes |= CLASS_PROTOCOL | CLASS_BUS_ERROR
        protocol = {ErrorKind.BIT: PROTOCOL_BIT, ErrorKind.FORM: PROTOCOL_FORM, ErrorKind.STUFF: PROTOCOL_STUFF}.get(
            kind, 0
        )
    if sending and kind is not None:
        protocol |= PROTOCOL_SENDING
    return classes, bytes((0, control, protocol, 0, 0, 0, min(tx_errors, 255), min(rx_errors, 255)))
