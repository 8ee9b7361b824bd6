"""The device's codec, profile 5 and MACs against vectors from outside."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim import e2e, frames, secoc
from firmware_sim.e2e import Check, Machine, Receiver
from firmware_sim.frames import FIELDS, Reject

requirement = pytest.mark.requirement

# AUTOSAR SWS_CRCLibrary, table of CRC16 (0x1021) results.
CRC_VECTORS = [
    ("00000000", 0x84C0),
    ("f20183", 0xD374),
    ("0faa0055", 0x2023),
    ("00ff5511", 0xB8F9),
    ("332255aabbccddeeff", 0xF53F),
    ("926b55", 0x0745),
    ("ffffffff", 0x1D0F),
]


@requirement("P1")
@pytest.mark.parametrize(("data", "crc"), CRC_VECTORS)
def test_crc_vectors_of_autosar(data: str, crc: int) -> None:
    assert e2e.crc16(bytes.fromhex(data)) == crc


@requirement("P6")
@pytest.mark.parametrize(
    ("length", "mac"),
    [
        (0, "bb1d6929e95937287fa37d129b756746"),
        (16, "070a16b46b4d4144f79bdd9dd04a287c"),
        (40, "dfa66747de9ae63030ca32611497c827"),
        (64, "51f0bebf7e3b9d92fc49741779363cfe"),
    ],
)
def test_cmac_vectors_of_rfc_4493(length: int, mac: str) -> None:
    key = bytes.fromhex("2b7e151628aed2a6abf7158809cf4f3c")
    message = bytes.fromhex(
        "6bc1bee22e409f96e93d7e117393172aae2d8a571e03ac9c9eb76fac45af8e51"
        "30c81c46a35ce411e5fbc1191a0a52eff69f2445df4f9b17ad2b417be66c3710"
    )
    assert secoc.cmac(key, message[:length]).hex() == mac


@requirement("P6")
def test_session_key_is_sp_800_108_in_counter_mode() -> None:
    from cryptography.hazmat.primitives.ciphers.algorithms import AES
    from cryptography.hazmat.primitives.kdf.kbkdf import KBKDFCMAC, CounterLocation, Mode

    context = bytes.fromhex("11223344556677880b007b002a")
    oracle = KBKDFCMAC(
        AES, Mode.CounterMode, 16, 1, 2, CounterLocation.BeforeFixed, b"hilbridge session v1", context, None
    )
    key = b"0123456789abcdef"
    assert secoc.session_key(key, 0x11223344, 0x55667788, 0x0B007B00, 42) == oracle.derive(key)


@requirement("P6")
def test_macs_bind_everything_they_name() -> None:
    key, act = b"k" * 16, bytes(range(8))
    macs = {
        secoc.act_mac(key, 1, 5, act),
        secoc.act_mac(key, 2, 5, act),
        secoc.act_mac(key, 1, 5 + 256, act),
        secoc.act_mac(key, 1, 5, act[::-1]),
        secoc.act_mac(b"l" * 16, 1, 5, act),
        secoc.arm_mac(key, 1, 1, 5, 6),
        secoc.arm_mac(key, 2, 1, 5, 6),
        secoc.arm_mac(key, 1, 2, 5, 6),
        secoc.arm_mac(key, 1, 1, 6, 6),
        secoc.arm_mac(key, 1, 1, 5, 7),
    }
    assert len(macs) == 10
    assert all(0 <= mac <= 0xFFFFFFFF for mac in macs)


@requirement("P6")
def test_macs_have_the_values_a_port_must_reproduce() -> None:
    key = secoc.session_key(b"hilbridge-demo-k", 1, 2, 3, 4)
    assert secoc.act_mac(key, 4, 5, bytes(8)) == int.from_bytes(
        secoc.cmac(key, bytes.fromhex("00600400000005") + bytes(8))[:4], "big"
    )
    assert secoc.arm_mac(key, 1, 4, 1, 2) == int.from_bytes(
        secoc.cmac(key, bytes.fromhex("018201040000000100000002"))[:4], "big"
    )


@requirement("P6")
@pytest.mark.parametrize(
    ("low", "last", "whole"),
    [(1, 0, 1), (0, 0, 256), (5, 5, 261), (6, 5, 6), (255, 0, 255), (0, 255, 256), (3, 0x1FE, 0x203)],
)
def test_whole_freshness_is_the_next_that_fits(low: int, last: int, whole: int) -> None:
    assert secoc.FRESHNESS_LIMIT == 0xFFFFFFFF
    assert secoc.whole_freshness(low, last) == whole


@given(st.integers(0, 0xFFFFFF00), st.integers(1, 256))
def test_freshness_is_found_again_after_any_gap_below_a_wrap(last: int, step: int) -> None:
    assert secoc.whole_freshness((last + step) & 0xFF, last) == last + step


@requirement("P1", "P2")
def test_protect_and_check_agree_and_a_frame_in_error_moves_no_counter() -> None:
    data = e2e.protect(frames.ACT_CMD, frames.pack(frames.ACT_CMD, (1, 0, 0, 0, 0, 255)), 300)
    assert data[2] == 300 - 256
    status, receiver = e2e.check(frames.ACT_CMD, data, Receiver())
    assert (status, receiver.counter, receiver.machine) == (Check.OK, 44, Machine.INIT)
    following = e2e.protect(frames.ACT_CMD, data, 301)
    assert e2e.check(frames.ACT_CMD, following, receiver)[0] == Check.OK
    for position in range(8):
        broken = bytearray(data)
        broken[position] ^= 0x80
        status, after = e2e.check(frames.ACT_CMD, bytes(broken), receiver)
        assert status == Check.ERROR
        assert (after.counter, after.lost) == (44, 0)
    assert e2e.check(frames.ACT_AUTH, data, Receiver())[0] == Check.ERROR  # another Data ID


def through(*results: Check) -> Machine:
    receiver = Receiver()
    for result in results:
        receiver = e2e.advance(receiver, result)
    return receiver.machine


OK, E, R, N, L, W = Check.OK, Check.ERROR, Check.REPEATED, Check.NO_NEW_DATA, Check.OK_SOME_LOST, Check.WRONG_SEQUENCE


@requirement("P1", "S2")
@pytest.mark.parametrize(
    ("results", "machine"),
    [
        ((), Machine.NO_DATA),
        ((E,), Machine.NO_DATA),
        ((N,), Machine.NO_DATA),
        ((OK,), Machine.INIT),
        ((W,), Machine.INIT),
        ((OK, OK), Machine.VALID),
        ((OK, L), Machine.VALID),
        ((OK, R), Machine.INIT),
        ((OK, R, OK), Machine.VALID),
        ((OK, E, OK), Machine.VALID),
        ((OK, E, E), Machine.INVALID),
        ((OK, OK, E), Machine.VALID),
        ((OK, OK, E, E), Machine.INVALID),
        ((OK, OK, E, OK, OK, E), Machine.INVALID),
        ((OK, OK, E, OK, OK, OK, E), Machine.VALID),
        ((OK, OK, R, R, R), Machine.VALID),
        ((OK, OK, R, R, R, R), Machine.INVALID),
        ((OK, OK, W, W, W, W), Machine.INVALID),
        ((OK, OK, E, E, OK, OK), Machine.INVALID),
        ((OK, OK, E, E, OK, OK, OK), Machine.INVALID),
        ((OK, OK, E, E, OK, OK, OK, OK), Machine.VALID),
        ((OK, OK, R, R, R, R, OK), Machine.INVALID),
        ((OK, OK, R, R, R, R, OK, OK), Machine.VALID),
    ],
)
def test_the_e2e_state_machine(results: tuple[Check, ...], machine: Machine) -> None:
    assert through(*results) == machine


@requirement("W1")
def test_overdue_makes_invalid_until_two_good_frames() -> None:
    assert e2e.overdue(Receiver()) == Receiver()
    receiver = e2e.overdue(Receiver(7, Machine.VALID, (OK, OK, OK, OK), 3))
    assert receiver == Receiver(7, Machine.INVALID, (N, N, N, N), 3)
    receiver = e2e.advance(receiver, OK)
    assert receiver.machine == Machine.INVALID
    assert e2e.advance(receiver, L).machine == Machine.VALID


@requirement("P9")
@given(st.sampled_from([*FIELDS, 0, 0x7FF, 0x123]), st.binary(max_size=12))
def test_h9_unpack_never_raises_and_says_why(can_id: int, data: bytes) -> None:
    why, values = frames.unpack(can_id, data)
    if why == Reject.ACCEPTED:
        assert len(values) == len(FIELDS[can_id])
        packed = frames.pack(can_id, values)
        assert packed[3:] == data[3:]
    else:
        assert values == ()
    if can_id in FIELDS and len(data) != 8:
        assert why == Reject.LENGTH
    if can_id not in FIELDS:
        assert why == Reject.UNKNOWN_ID


@pytest.mark.parametrize("change", [-1, 1])
def test_pack_refuses_what_is_out_of_range(change: int) -> None:
    values = [field.highest if change > 0 else field.lowest for field in FIELDS[frames.CTRL_MEAS]]
    frames.pack(frames.CTRL_MEAS, tuple(values))
    values[1] += change
    with pytest.raises(ValueError, match="Angle"):
        frames.pack(frames.CTRL_MEAS, tuple(values))


def test_reserved_bits_are_what_no_field_uses() -> None:
    assert frames.RESERVED_MASK[frames.ACT_CMD] == 0b11 << 62
    assert frames.RESERVED_MASK[frames.ACT_AUTH] == 0
    assert frames.RESERVED_MASK[frames.CTRL_STATUS] == 1 << 63
