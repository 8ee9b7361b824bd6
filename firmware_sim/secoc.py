"""Act authorisation on the device: session keys, truncated MACs and freshness (after AUTOSAR SecOC, PRS_SecOcProtocol).

MAC: AES-128-CMAC (RFC 4493), first four bytes, big endian. Session key: CMAC as the pseudo-random function of
NIST SP 800-108 in counter mode, one block. All that enters a MAC has a fixed length: no field slides into another.
"""

from __future__ import annotations

from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.cmac import CMAC

from firmware_sim.frames import ACT_CMD, ARM_RESPONSE

# Printed in the sources, therefore worth nothing: the bridge refuses it on a physical bus.
DEMO_KEY = b"hilbridge-demo-k"
FRESHNESS_LIMIT = 0xFFFFFFFF
SESSION_LABEL = b"hilbridge session v1"


def cmac(key: bytes, message: bytes) -> bytes:
    """AES-128-CMAC of `message`, 16 bytes (RFC 4493)."""
    mac = CMAC(AES(key))
    mac.update(message)
    return mac.finalize()


def session_key(shared_key: bytes, bridge_nonce: int, device_nonce: int, boot_nonce: int, session: int) -> bytes:
    """16-byte key of one session, from the shared key, the nonces of both sides and the nonce of this boot."""
    context = bridge_nonce.to_bytes(4, "big") + device_nonce.to_bytes(4, "big") + boot_nonce.to_bytes(4, "big")
    return cmac(shared_key, b"\x01" + SESSION_LABEL + b"\x00" + context + bytes((session,)) + b"\x00\x80")


def truncated(key: bytes, message: bytes) -> int:
    """The 32 bits of the MAC that travel."""
    return int.from_bytes(cmac(key, message)[:4], "big")


def act_mac(key: bytes, session: int, freshness: int, act_cmd: bytes) -> int:
    """MAC of ACT_AUTH over id, session, the whole 32-bit freshness and the eight bytes of the ACT_CMD as sent."""
    return truncated(key, ACT_CMD.to_bytes(2, "big") + bytes((session,)) + freshness.to_bytes(4, "big") + act_cmd)


def arm_mac(key: bytes, purpose: int, session: int, bridge_nonce: int, device_nonce: int) -> int:
    """MAC of ARM_RESPONSE over id, purpose, session and both nonces."""
    nonces = bridge_nonce.to_bytes(4, "big") + device_nonce.to_bytes(4, "big")
    return truncated(key, ARM_RESPONSE.to_bytes(2, "big") + bytes((purpose, session)) + nonces)


def whole_freshness(low_byte: int, last: int) -> int:
    """The smallest value above `last` that ends in `low_byte`: freshness only ever grows."""
    candidate = (last & ~0xFF) | low_byte
    return candidate if candidate > last else candidate + 0x100
