"""Bridge and device on a perfect bus in virtual time: one call per millisecond, frames taken and given by hand."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from functools import cache

from firmware_sim.memory import ControllerState, Inputs, Received
from firmware_sim.secoc import DEMO_KEY
from hilbridge.core.bridge import Bridge, BridgeConfig
from hilbridge.limits import MS
from hilbridge.records import Action, Frame, GateDecision, HoldReason
from hilbridge.wire.codec import Codec, Decoded, RejectReason
from hilbridge.wire.link import WireLink
from hilbridge.wire.secoc import Authenticator
from tests.safety.stepping import PATIENCE_TICKS, Outputs, step

BOOT_NONCE = 0x0B007B00
ACT_TAKE = GateDecision(Action.ACT, 0, 0.9, HoldReason.NONE)
ACT_PUT = GateDecision(Action.ACT, 1, 0.9, HoldReason.NONE)
ACT_POUR = GateDecision(Action.ACT, 9, 0.9, HoldReason.NONE)
HOLD = GateDecision(Action.HOLD, None, 0.1, HoldReason.CONFIDENCE)
Link = Callable[[Received], list[Received]]


@cache
def codec() -> Codec:
    """The shipped DBC, read once."""
    return Codec()


def straight(frame: Received) -> list[Received]:
    """A link that carries every frame once."""
    return [frame]


class Rig:
    """`to_device` and `to_bridge` are the link, one hook each way; `decision` is what the gate says from now on."""

    def __init__(self, seed: int = 1, key: bytes = DEMO_KEY, arm: bool = True) -> None:
        self.random = random.Random(seed)
        self.wire = WireLink(codec())
        self.bridge = Bridge(
            self.wire,
            Authenticator(key),
            lambda: self.random.getrandbits(32),
            BridgeConfig(arm=arm),
            lambda: self.wire.counters,
        )
        self.state = ControllerState(DEMO_KEY, BOOT_NONCE)
        self.inputs = Inputs(velocity_mdeg_s=20_000)
        self.outputs = Outputs((), 0, 0, 0)
        self.decision: GateDecision | None = HOLD
        self.now_ms = 0
        self.bridge_runs = True
        self.tick_phase_ms = 0
        self.sensing_age_ms: int | None = 20
        self.to_device: Link = straight
        self.to_bridge: Link = straight
        self.sent: list[Received] = []
        self.history: list[tuple[int, str, int]] = []
        self._queue: list[Received] = []

    def stranger(self, *frames: Received) -> None:
        """Frames of somebody else on the bus: device and bridge hear them."""
        self.put(*frames)
        for frame in frames:
            for heard in self.to_bridge(frame):
                if self.bridge_runs:
                    self._bridge_hears(heard, self.now_ms * MS)

    def put(self, *frames: Frame | Received) -> None:
        """Frames that reach the device in the next millisecond and nobody else, besides what the bridge sends."""
        for frame in frames:
            taken = frame if isinstance(frame, Received) else Received(frame.can_id, frame.data)
            self._queue += self.to_device(taken)

    def _bridge_sends(self, frames: list[Frame]) -> None:
        for frame in frames:
            self.sent.append(Received(frame.can_id, frame.data))
            self.put(frame)

    def run(self, milliseconds: int, **changes: object) -> Rig:
        """Let time go by. `changes` are device inputs that hold during it (Inputs fields)."""
        for _ in range(milliseconds):
            self.tick(**changes)
        return self

    def tick(self, **changes: object) -> Outputs:
        """One millisecond: bridge (every 40th), then device, then the device's frames to the bridge."""
        self.now_ms += 1
        assert self.now_ms < PATIENCE_TICKS
        now_ns = self.now_ms * MS
        if self.bridge_runs and self.now_ms % 40 == self.tick_phase_ms:
            self.bridge.begin_tick(now_ns)
            oldest = None if self.sensing_age_ms is None else now_ns - self.sensing_age_ms * MS
            frames = self.bridge.tick(self.decision, oldest, (True, True, True), 7, now_ns)
            self._bridge_sends(frames)
        frames, self._queue = tuple(self._queue), []
        inputs = replace(self.inputs, frames=frames, random_u32=self.random.getrandbits(32), **changes)
        self.state, self.outputs = step(self.state, inputs, self.now_ms)
        self.history.append((self.now_ms, self.state.state.name, self.outputs.assist_unm))
        for can_id, data in self.outputs.frames:
            for heard in self.to_bridge(Received(can_id, data)):
                if self.bridge_runs:
                    self._bridge_hears(heard, now_ns)
        return self.outputs

    def _bridge_hears(self, heard: Received, now_ns: int) -> None:
        message = self.wire.decode(Frame(heard.can_id, heard.data, received_ns=now_ns))
        if isinstance(message, Decoded):
            self._bridge_sends(self.bridge.on_message(message.name, message.signals, message.counter, now_ns))
        elif message.reason is RejectReason.UNKNOWN_ID:
            self.bridge.session.on_stranger(message.name, now_ns)

    def until(self, state: str, limit_ms: int = 3000) -> Rig:
        """Run until the device is in `state`."""
        for _ in range(limit_ms):
            if self.state.state.name == state:
                return self
            self.tick()
        raise AssertionError(f"not {state} within {limit_ms} ms but {self.state.state.name} ({self.state.reason.name})")

    def assisting(self, decision: GateDecision = ACT_TAKE, settle_ms: int = 400) -> Rig:
        """Arm, hold, act; returns with torque on the joint."""
        self.until("READY")
        self.decision = decision
        self.until("ASSIST").run(settle_ms)
        assert self.state.state.name == "ASSIST"
        assert self.outputs.assist_unm != 0
        return self

    def milliseconds_until_zero(self, limit_ms: int = 1000) -> int:
        """Ticks until assist is exactly zero."""
        for elapsed in range(limit_ms):
            if self.outputs.assist_unm == 0:
                return elapsed
            self.tick()
        raise AssertionError("assist never reached zero")
