"""AES-128 and CMAC of the C: published vectors, and the library that the reference uses."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim import secoc
from firmware_sim.c import binding

pytestmark = pytest.mark.skipif(not binding.available(), reason="the C controller is not built")
KEY = bytes.fromhex("2b7e151628aed2a6abf7158809cf4f3c")
MESSAGE = bytes.fromhex(
    "6bc1bee22e409f96e93d7e117393172aae2d8a571e03ac9c9eb76fac45af8e51"
    "30c81c46a35ce411e5fbc1191a0a52eff69f2445df4f9b17ad2b417be66c3710"
)


@pytest.mark.parametrize(
    ("key", "block", "expected"),
    [
        ("000102030405060708090a0b0c0d0e0f", "00112233445566778899aabbccddeeff", "69c4e0d86a7b0430d8cdb78070b4c55a"),
        ("2b7e151628aed2a6abf7158809cf4f3c", "3243f6a8885a308d313198a2e0370734", "3925841d02dc09fbdc118597196a0b32"),
    ],
)
def test_aes_is_that_of_fips_197(key: str, block: str, expected: str) -> None:
    assert binding._native.aes128(bytes.fromhex(key), bytes.fromhex(block)).hex() == expected


@pytest.mark.parametrize(
    ("length", "expected"),
    [
        (0, "bb1d6929e95937287fa37d129b756746"),
        (16, "070a16b46b4d4144f79bdd9dd04a287c"),
        (40, "dfa66747de9ae63030ca32611497c827"),
        (64, "51f0bebf7e3b9d92fc49741779363cfe"),
    ],
)
def test_cmac_is_that_of_rfc_4493(length: int, expected: str) -> None:
    assert binding._native.cmac(KEY, MESSAGE[:length]).hex() == expected


@given(st.binary(min_size=16, max_size=16), st.binary(max_size=70))
def test_cmac_is_that_of_the_library(key: bytes, message: bytes) -> None:
    assert binding._native.cmac(key, message) == secoc.cmac(key, message)


def test_a_key_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match="16 bytes"):
        binding._native.cmac(b"short", b"")
    with pytest.raises(ValueError, match="16 bytes"):
        binding._native.aes128(KEY, b"short")
