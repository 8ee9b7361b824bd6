from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.wire import e2e
from hilbridge.wire.e2e import CheckStatus, MachineState, ReceiverState

requirement = pytest.mark.requirement


# E2E on the bridge


@requirement("P1")
@pytest.mark.parametrize(
    ("data", "crc"),
    [("00000000", 0x84C0), ("f20183", 0xD374), ("0faa0055", 0x2023), ("00ff5511", 0xB8F9), ("ffffffff", 0x1D0F)],
)
def test_crc_vectors_of_autosar(data: str, crc: int) -> None:
    # The Data ID enters low byte first: with the vector's last two bytes as Data ID the CRC is the vector's.
    raw = bytes.fromhex(data)
    assert e2e.crc(b"\0\0" + raw[:-2], int.from_bytes(raw[-2:], "little")) == crc


@requirement("P1")
def test_protect_vector_of_profile_5() -> None:
    assert e2e.protect(bytes(8), 0x1234, 0).hex() == "1cca000000000000"
    assert e2e.protect(bytes(8), 0x1234, 256).hex() == "1cca000000000000"


@pytest.mark.parametrize(
    ("delta", "status"),
    [
        (0, CheckStatus.REPEATED),
        (1, CheckStatus.OK),
        (2, CheckStatus.SOME_LOST),
        (3, CheckStatus.SOME_LOST),
        (4, CheckStatus.WRONG_SEQUENCE),
        (255, CheckStatus.WRONG_SEQUENCE),
    ],
)
def test_sequence(delta: int, status: CheckStatus) -> None:
    before = ReceiverState(254, MachineState.VALID, (CheckStatus.OK,), 5)
    found, after = e2e.check(e2e.protect(bytes(8), 7, 254 + delta), 7, 3, before)
    assert found is status
    assert after.counter == (254 + delta) % 256
    assert after.lost == 5 + (delta - 1 if status is CheckStatus.SOME_LOST else 0)
    assert after.window == (CheckStatus.OK, status)


def test_errors_move_no_counter_and_short_data_is_an_error() -> None:
    before = ReceiverState(9, MachineState.VALID, (CheckStatus.OK, CheckStatus.OK), 1)
    right_crc_of_nothing = e2e.crc(b"", 7).to_bytes(2, "little")
    for data in (bytes(8), b"", b"\xff", b"\xff\xff", right_crc_of_nothing):
        found, after = e2e.check(data, 7, 3, before)
        assert found is CheckStatus.ERROR
        assert (after.counter, after.lost) == (9, 1)
    found, after = e2e.check(e2e.protect(bytes(3), 7, 10), 7, 3, before)  # the shortest that holds a counter
    assert (found, after.counter) == (CheckStatus.OK, 10)
    assert ReceiverState().lost == 0


OK, E, R, N, L, W = (
    CheckStatus.OK,
    CheckStatus.ERROR,
    CheckStatus.REPEATED,
    CheckStatus.NO_NEW_DATA,
    CheckStatus.SOME_LOST,
    CheckStatus.WRONG_SEQUENCE,
)


@requirement("P10")
@given(st.lists(st.sampled_from([OK, E, R, N, L, W]), max_size=12))
def test_both_sides_run_the_same_state_machine(results: list[CheckStatus]) -> None:
    from firmware_sim import e2e as device

    theirs = {OK: device.Check.OK, E: device.Check.ERROR, R: device.Check.REPEATED, N: device.Check.NO_NEW_DATA}
    theirs |= {L: device.Check.OK_SOME_LOST, W: device.Check.WRONG_SEQUENCE}
    mine, other = ReceiverState(), device.Receiver()
    for result in results:
        mine = e2e.advance(mine, result)
        other = device.advance(other, theirs[result])
        assert mine.machine.name == other.machine.name
        assert len(mine.window) == len(other.window)


def test_a_full_window_of_good_frames_keeps_the_machine_valid_or_makes_it_so() -> None:
    for machine in (MachineState.INIT, MachineState.VALID, MachineState.INVALID):
        before = ReceiverState(7, machine, (OK, OK, OK, OK), 3)
        assert e2e.advance(before, OK) == ReceiverState(7, MachineState.VALID, (OK, OK, OK, OK), 3)


@pytest.mark.parametrize(
    ("results", "machine"),
    [
        ((E,), MachineState.NO_DATA),
        ((N,), MachineState.NO_DATA),
        ((OK,), MachineState.INIT),
        ((OK, R), MachineState.INIT),
        ((OK, L), MachineState.VALID),
        ((OK, E, OK), MachineState.VALID),
        ((OK, E, E), MachineState.INVALID),
        ((OK, OK, E), MachineState.VALID),
        ((OK, OK, E, E), MachineState.INVALID),
        ((OK, OK, E, OK, OK, OK, E), MachineState.VALID),
        ((OK, OK, R, R, R), MachineState.VALID),
        ((OK, OK, W, W, W, W), MachineState.INVALID),
        ((OK, OK, OK, OK, OK, E), MachineState.VALID),
        ((OK, OK, OK, OK, OK, E, E), MachineState.INVALID),
        ((OK, OK, OK, OK, OK, R, R, R, R), MachineState.INVALID),
        ((OK, OK, E, E, OK, OK, OK), MachineState.INVALID),
        ((OK, OK, E, E, OK, OK, OK, OK), MachineState.VALID),
        ((OK, OK, R, R, R, R, OK), MachineState.INVALID),
        ((OK, OK, R, R, R, R, OK, L), MachineState.VALID),
    ],
)
def test_the_state_machine(results: tuple[CheckStatus, ...], machine: MachineState) -> None:
    state = ReceiverState()
    for result in results:
        state = e2e.advance(state, result)
    assert state.machine is machine
