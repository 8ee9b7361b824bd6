"""Act authorisation on the bridge: shared key, session keys, truncated MACs (after AUTOSAR SecOC; docs/decisions/102).

AES-128-CMAC (RFC 4493), first four bytes big endian; session keys by NIST SP 800-108 in counter mode with CMAC. The
device has its own implementation; tests hold the two together.
"""

from __future__ import annotations

import struct

from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.cmac import CMAC

_ACT_CMD_ID = 0x060
_ARM_RESPONSE_ID = 0x182
_PURPOSES = {"Arm": 1, "ClearLatch": 2}


def _cmac(key: bytes, message: bytes) -> bytes:
    mac = CMAC(AES(key))
    mac.update(message)
    return mac.finalize()


def _mac32(key: bytes, message: bytes) -> int:
    return int.from_bytes(_cmac(key, message)[:4], "big")


class Authenticator:
    """What core.bridge is handed as its crypto: derives session keys and authenticates under them."""

    def __init__(self, shared_key: bytes) -> None:
        """`shared_key` is 16 bytes, the same on both sides."""
        self._shared_key = shared_key

    def session_key(self, bridge_nonce: int, device_nonce: int, boot_nonce: int, session: int) -> bytes:
        """Key of one session from the nonces of both sides (32 bits each) and of the device's boot."""
        context = struct.pack(">IIIB", bridge_nonce, device_nonce, boot_nonce, session)
        return _cmac(self._shared_key, b"\x01hilbridge session v1\x00" + context + b"\x00\x80")

    def act_mac(self, key: bytes, session: int, freshness: int, act_cmd: bytes) -> int:
        """32-bit MAC over id, session, whole freshness and the eight bytes of the ACT_CMD as sent."""
        return _mac32(key, struct.pack(">HBI", _ACT_CMD_ID, session, freshness) + act_cmd)

    def arm_mac(self, key: bytes, purpose: str, session: int, bridge_nonce: int, device_nonce: int) -> int:
        """32-bit MAC of ARM_RESPONSE; `purpose` as in the DBC's value table."""
        fixed = struct.pack(">HBB", _ARM_RESPONSE_ID, _PURPOSES[purpose], session)
        return _mac32(key, fixed + struct.pack(">II", bridge_nonce, device_nonce))
