from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from hilbridge.bus.port.socketcan import pack_can_frame, parse_can_frame
from hilbridge.records import Frame


@given(
    st.booleans().flatmap(
        lambda extended: st.tuples(st.just(extended), st.integers(0, 0x1FFF_FFFF if extended else 0x7FF))
    ),
    st.binary(max_size=8),
)
def test_frames_survive_the_kernels_structure(identity: tuple[bool, int], data: bytes) -> None:
    extended, can_id = identity
    frame = Frame(can_id, data, 1, 2, is_extended=extended, hardware_ns=3)
    assert parse_can_frame(pack_can_frame(frame), 1, 2, 3) == frame
    fd = Frame(can_id, data, 1, 2, is_extended=extended, is_fd=True)
    assert parse_can_frame(pack_can_frame(fd), 1, 2, 0) == fd


@given(st.binary(max_size=80))
def test_no_frame_bytes_raise(raw: bytes) -> None:
    frame = parse_can_frame(raw, 0, 0, 0)
    assert (frame is None) == (len(raw) not in (16, 72))
