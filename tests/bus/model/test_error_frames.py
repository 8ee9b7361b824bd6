from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.bus.model.error_frames import ErrorKind, ErrorState, read_error_frame, write_error_frame


@pytest.mark.parametrize(
    ("state", "tec", "rec"),
    [
        (ErrorState.ACTIVE, 0, 0),
        (ErrorState.WARNING, 96, 0),
        (ErrorState.WARNING, 0, 119),
        (ErrorState.PASSIVE, 128, 0),
        (ErrorState.PASSIVE, 0, 135),
        (ErrorState.BUS_OFF, 256, 0),
    ],
)
def test_error_frames_say_what_was_written(state: ErrorState, tec: int, rec: int) -> None:
    event = read_error_frame(*write_error_frame(state, tec, rec))
    assert (event.controller, event.tx_errors, event.rx_errors) == (state, min(tec, 255), rec)


@pytest.mark.parametrize("kind", list(ErrorKind))
def test_failed_attempts_change_no_state(kind: ErrorKind) -> None:
    event = read_error_frame(*write_error_frame(None, 8, 0, kind=kind, sending=True))
    assert (event.controller, event.tx_errors, event.no_ack) == (None, 8, kind is ErrorKind.ACK)


def test_error_frames_as_linux_drivers_write_them() -> None:
    # A gs_usb adapter with nobody on the bus: CAN_ERR_ACK; then CAN_ERR_CRTL with TX_PASSIVE; a full receive buffer.
    assert read_error_frame(0x020, bytes(8)).no_ack
    passive = read_error_frame(0x004, bytes((0, 0x20, 0, 0, 0, 0, 128, 0)))
    assert (passive.controller, passive.tx_errors) == (ErrorState.PASSIVE, 128)
    assert read_error_frame(0x004, bytes((0, 0x01, 0, 0, 0, 0, 0, 0))).overflow
    assert read_error_frame(0x040, b"").controller is ErrorState.BUS_OFF
    assert read_error_frame(0x100, b"").controller is ErrorState.ACTIVE


@given(st.integers(0, 0x1FFF_FFFF), st.binary(max_size=64))
def test_no_error_frame_raises(can_id: int, data: bytes) -> None:
    read_error_frame(can_id, data)
