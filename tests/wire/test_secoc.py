from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim import secoc as device
from hilbridge.wire import secoc
from hilbridge.wire.secoc import Authenticator

requirement = pytest.mark.requirement


U32 = st.integers(0, 0xFFFFFFFF)


@requirement("P6")
def test_cmac_vector_of_rfc_4493() -> None:
    key = bytes.fromhex("2b7e151628aed2a6abf7158809cf4f3c")
    assert secoc._cmac(key, b"").hex() == "bb1d6929e95937287fa37d129b756746"
    assert secoc._mac32(key, b"") == 0xBB1D6929


@requirement("P6", "P10")
@given(st.binary(min_size=16, max_size=16), U32, U32, U32, st.integers(1, 255), U32, st.binary(min_size=8, max_size=8))
def test_both_sides_derive_the_same(
    shared: bytes, bridge: int, challenge: int, boot: int, session: int, freshness: int, act: bytes
) -> None:
    mine = Authenticator(shared)
    key = mine.session_key(bridge, challenge, boot, session)
    assert key == device.session_key(shared, bridge, challenge, boot, session)
    assert mine.act_mac(key, session, freshness, act) == device.act_mac(key, session, freshness, act)
    for code, purpose in ((1, "Arm"), (2, "ClearLatch")):
        assert mine.arm_mac(key, purpose, session, bridge, challenge) == device.arm_mac(
            key, code, session, bridge, challenge
        )
