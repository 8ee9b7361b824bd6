"""The bridge's side of arming: request, challenge, response, and the freshness that every ACT uses up.

Theory of operation: the bridge asks once it knows the device's boot nonce and MAC failures; the device answers with a
nonce of its own; the bridge proves that it knows the key; CTRL_STATUS confirms. Then each ACT uses up one freshness value.
A session is lost on any doubt and armed anew from nothing; nothing of an old one can be used in the next. Pure: nonces
and cryptography are handed in, time is an argument (monotonic ns).
"""

from __future__ import annotations

from enum import StrEnum
from typing import Protocol

from hilbridge.limits import CHALLENGE_WAIT_NS, CONFIRM_WAIT_NS, FRESHNESS_LIMIT, STRANGER_NS


class Phase(StrEnum):
    """How far arming has come."""

    IDLE = "idle"
    REQUESTED = "requested"
    RESPONDED = "responded"
    ARMED = "armed"


class Purpose(StrEnum):
    """What a handshake is for; the values are names of the DBC's value table."""

    ARM = "Arm"
    CLEAR_LATCH = "ClearLatch"


class Crypto(Protocol):
    """What hilbridge.wire.secoc.Authenticator provides; 32-bit nonces and MACs, keys as bytes."""

    def session_key(self, bridge_nonce: int, device_nonce: int, boot_nonce: int, session: int) -> bytes:
        """Key of one session."""

    def act_mac(self, key: bytes, session: int, freshness: int, act_cmd: bytes) -> int:
        """MAC of an ACT_CMD as sent."""

    def arm_mac(self, key: bytes, purpose: str, session: int, bridge_nonce: int, device_nonce: int) -> int:
        """MAC of an ARM_RESPONSE."""


class Session:
    """State of the handshake. `number` is 0 unless armed; `dropped` counts armed sessions lost, `why` the last;
    `disturbed` counts handshakes that came to nothing although nobody blamed the key."""

    def __init__(self, crypto: Crypto) -> None:
        """`crypto` knows the shared key."""
        self._crypto = crypto
        self.phase = Phase.IDLE
        self.number = 0
        self.dropped = 0
        self.why = ""
        self.refused = False
        self.disturbed = 0
        self._key = b""
        self._freshness = 0
        self._boot_nonce: int | None = None
        # MAC failures that the device had counted before any response of ours; None until it has told.
        self._foreign_failures: int | None = None
        self._unconfirmed = False
        self._bridge_nonce = 0
        self._nonce_spent = True
        self._offered = 0
        self._purpose = Purpose.ARM
        self._retry_ns: int | None = None
        self._stranger_ns: int | None = None  # when somebody else was last heard to ask
        self._strange_responses = 0  # of others, each of which may be a MAC failure of the device's
        self._wait_ns = CHALLENGE_WAIT_NS

    @property
    def armed(self) -> bool:
        """Whether ACT may be authorised."""
        return self.phase is Phase.ARMED

    def may_request(self, now_ns: int) -> bool:
        """Whether it is time to ask (again): the device is known, not armed, and the last try has run out.

        Known is a device whose MAC failures are: without them, one of before would be taken for ours and end all tries.
        """
        if self._boot_nonce is None or self._foreign_failures is None or self.refused or self.armed:
            return False
        return self._retry_ns is None or now_ns >= self._retry_ns

    def request(self, purpose: Purpose, nonce: int, now_ns: int) -> dict[str, int | str]:
        """Signals of the ARM_REQUEST that starts a handshake, or repeats one that came to nothing.

        The nonce is kept until a session was confirmed under it: a challenge that was only late, also to a request that
        was dropped meanwhile, is then answered with the right key, not with a MAC that the device would count as a
        failure. Every challenge has a nonce of the device's own, so no two sessions share a key.
        """
        if self._nonce_spent:
            self._bridge_nonce = nonce
            self._nonce_spent = False
        if self.phase is Phase.RESPONDED:  # neither a session nor a MAC failure came of it: the key is not to blame
            self.disturbed += 1
        self.phase = Phase.REQUESTED
        self._purpose = purpose
        self._retry_ns = now_ns + CHALLENGE_WAIT_NS
        return {"BridgeNonce": self._bridge_nonce, "Purpose": purpose.value}

    def on_heartbeat(self, boot_nonce: int) -> None:
        """CTRL_HB: a device with another boot nonce has started anew and knows nothing of the session."""
        if boot_nonce != self._boot_nonce:
            self.drop("device restarted")
            self.refused = False
            self._foreign_failures = None
            self._unconfirmed = False
            self._strange_responses = 0
        self._boot_nonce = boot_nonce

    def on_stranger(self, message: str, now_ns: int) -> None:
        """A message that only this bridge may send came from somebody else.

        After an ARM_REQUEST the challenge that comes next may be for that one; after an ARM_RESPONSE a MAC failure may be.
        """
        if message == "ARM_REQUEST":
            self._stranger_ns = now_ns
        elif message == "ARM_RESPONSE":
            self._strange_responses += 1

    def on_challenge(self, device_nonce: int, number: int, now_ns: int) -> dict[str, int | str] | None:
        """Signals of the ARM_RESPONSE to an ARM_CHALLENGE; None when none was asked for, or somebody else asked too.

        An answer to another's challenge would be a wrong MAC, blamed on the key. To wait and ask again costs nothing.
        """
        if self.phase is not Phase.REQUESTED or self._boot_nonce is None:
            return None
        if self._stranger_ns is not None and now_ns - self._stranger_ns <= STRANGER_NS:
            self.phase = Phase.IDLE
            self.disturbed += 1
            self._retry_ns = now_ns + self._wait_ns
            self._wait_ns = min(2 * self._wait_ns, CONFIRM_WAIT_NS)
            return None
        self._key = self._crypto.session_key(self._bridge_nonce, device_nonce, self._boot_nonce, number)
        mac = self._crypto.arm_mac(self._key, self._purpose.value, number, self._bridge_nonce, device_nonce)
        self._offered = number
        self._unconfirmed = True
        self._retry_ns = now_ns + CONFIRM_WAIT_NS
        # A cleared latch leaves no session behind: the device says so by leaving LATCHED.
        self.phase = Phase.RESPONDED if self._purpose is Purpose.ARM else Phase.IDLE
        return {"Mac": mac, "Session": number}

    def on_status(self, device_armed: bool, number: int) -> None:
        """CTRL_STATUS: confirms what was offered, or shows that the device has let go of the session."""
        if self.phase is Phase.RESPONDED and device_armed and number == self._offered:
            self.phase = Phase.ARMED
            self._unconfirmed = False
            self._nonce_spent = True
            self.number = number
            self._freshness = 0
            self._strange_responses = 0
            self._wait_ns = CHALLENGE_WAIT_NS
        elif self.armed and not (device_armed and number == self.number):
            self.drop("device disarmed")

    def on_mac_failures(self, failures: int) -> None:
        """CTRL_DIAG: more MAC failures than before our response, which goes unconfirmed: the keys differ.

        Failures of before may be another bridge's and do not count. Once a response is out, every further one may be ours
        until a session confirms the key, also where the counter was lost on the bus or came between two tries.
        """
        known = self._foreign_failures
        if not self._unconfirmed or known is None or failures < known:  # a counter that fell has begun anew
            self._foreign_failures = failures
        elif failures - known <= self._strange_responses:  # as many as others were heard to send
            self._strange_responses -= failures - known
            self._foreign_failures = failures
        elif self.phase is Phase.RESPONDED:
            self.refused = True
            self.phase = Phase.IDLE

    def authorise(self, act_cmd: bytes) -> dict[str, int | str] | None:
        """Signals of the ACT_AUTH for an ACT_CMD as sent; None (and no session any more) when it cannot be had."""
        if not self.armed:
            return None
        if self._freshness >= FRESHNESS_LIMIT:
            self.drop("freshness used up")
            return None
        self._freshness += 1
        mac = self._crypto.act_mac(self._key, self.number, self._freshness, act_cmd)
        return {"Freshness": self._freshness & 0xFF, "Mac": mac}

    def drop(self, why: str) -> None:
        """Forget the session and any handshake under way; arming starts anew."""
        if self.armed:
            self.dropped += 1
            self.why = why
        self.phase = Phase.IDLE
        self.number = 0
        self._key = b""
        self._retry_ns = None
