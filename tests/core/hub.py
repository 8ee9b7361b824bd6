"""One bridge whose bus is a list, for the tests of this room."""

from __future__ import annotations

from typing import Any

from hilbridge.core.bridge import Bridge, BridgeConfig
from hilbridge.limits import MS
from hilbridge.records import Frame, GateDecision
from hilbridge.wire.codec import Decoded
from hilbridge.wire.keys import DEMO_KEY
from hilbridge.wire.link import WireLink
from hilbridge.wire.secoc import Authenticator
from tests.safety.rig import HOLD, codec

VALID = (True, True, True)


class Hub:
    """A bridge alone, with a device whose messages are made by hand."""

    def __init__(self, **config: bool) -> None:
        self.wire = WireLink(codec())
        self.nonces = iter(range(1000, 2000))
        self.bridge = Bridge(
            self.wire,
            Authenticator(DEMO_KEY),
            lambda: next(self.nonces),
            BridgeConfig(**config),
            lambda: self.wire.counters,
        )
        self.now_ns = 1_000 * MS
        self.counter = 0

    def status(self, state: str = "Ready", **signals: Any) -> list[Frame]:
        self.counter = (self.counter + 1) & 0xFF
        full = {
            "State": state,
            "Reason": "None",
            "AppliedVerb": "None",
            "Authority": 0,
            "AcceptedCounter": 0,
            "Session": self.bridge.session.number,
            "Armed": int(self.bridge.session.armed),
            "AssistZero": 1,
        }
        return self.bridge.on_message("CTRL_STATUS", full | signals, self.counter, self.now_ns)

    def heartbeat(self, nonce: int = 5, version: int = 1) -> None:
        self.bridge.on_message("CTRL_HB", {"ProtocolVersion": version, "BootNonce": nonce}, 1, self.now_ns)
        self.bridge.on_message("CTRL_DIAG", {"Index": "MacFailures", "MacFailures": 0}, 1, self.now_ns)

    def tick(
        self,
        decision: GateDecision | None = HOLD,
        *,
        after_ms: int = 40,
        age_ms: int | None = 20,
        state: str | None = "Ready",
    ) -> dict[str, dict[str, Any]]:
        """Time, a status, a tick; returns what was sent by message name."""
        self.now_ns += after_ms * MS
        if state is not None:
            self.status(state)
        self.bridge.begin_tick(self.now_ns)
        oldest = None if age_ms is None else self.now_ns - age_ms * MS
        return self.read(self.bridge.tick(decision, oldest, VALID, 0x1234, self.now_ns))

    def read(self, sent: list[Frame]) -> dict[str, dict[str, Any]]:
        found = {}
        for frame in sent:
            decoded = codec().decode(frame)
            assert isinstance(decoded, Decoded)
            found[decoded.name] = dict(decoded.signals)
        return found

    def arm(self, number: int = 9) -> Hub:
        self.heartbeat()
        request = self.tick(state="Follow")["ARM_REQUEST"]
        assert request["Purpose"] == "Arm"
        answer = self.bridge.on_message("ARM_CHALLENGE", {"DeviceNonce": 77, "Session": number}, 1, self.now_ns)
        assert [frame.can_id for frame in answer] == [0x182]
        self.status("Follow", Session=number, Armed=1)
        assert self.bridge.session.armed
        return self
