"""A STOP in any form stops both ends alike, and an error frame stops neither (H2)."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from firmware_sim import frames
from firmware_sim.memory import ControllerState, Received
from firmware_sim.receive import receive
from firmware_sim.states import State
from hilbridge.records import Frame
from hilbridge.wire.codec import Codec, Decoded
from hilbridge.wire.link import WireLink

CODEC = Codec()


@given(st.binary(max_size=64), st.booleans(), st.booleans(), st.booleans())
def test_h2_any_form_stops_both_ends(data: bytes, fd: bool, extended: bool, remote: bool) -> None:
    frame = Frame(frames.STOP, data, is_fd=fd, is_extended=extended, is_remote=remote)
    heard = WireLink(CODEC).decode(frame)
    assert isinstance(heard, Decoded)
    assert heard.name == "STOP"
    state = ControllerState(bytes(16), 1, state=State.ASSIST)
    receive(state, Received(frames.STOP, data, plain=not (fd or extended or remote)), 0, 0)
    assert state.state is State.ESTOP


def test_an_error_frame_is_no_stop() -> None:
    assert not isinstance(WireLink(CODEC).decode(Frame(frames.STOP, bytes(8), is_error=True)), Decoded)
