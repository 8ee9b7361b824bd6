"""The bridge's own machine on a line of any time, without senses: a decision is set, its frames go out every 40 ms."""

from __future__ import annotations

from collections.abc import Callable

from firmware_sim.states import State
from hilbridge.conformance.line import Line
from hilbridge.core.bridge import Bridge, BridgeConfig
from hilbridge.limits import MS, TICK_NS
from hilbridge.records import Frame, GateDecision
from hilbridge.wire.codec import Codec, Decoded
from hilbridge.wire.keys import DEMO_KEY
from hilbridge.wire.link import WireLink
from hilbridge.wire.secoc import Authenticator
from tests.safety.rig import HOLD


class BridgeByHand:
    """`speaks` off is a bridge that hangs. `state` and `assist_zero` are what the device told last."""

    def __init__(self, line: Line) -> None:
        self.line = line
        self.wire = WireLink(Codec())
        numbers = iter(range(0x1234, 0x800000))
        self.bridge = Bridge(self.wire, Authenticator(DEMO_KEY), lambda: next(numbers), BridgeConfig(), dict)
        self.decision: GateDecision | None = HOLD
        self.speaks = True
        self.state, self.assist_zero = State.BOOT, True
        self._next_ns = line.now_ns()

    def until(self, true: Callable[[], bool], what: str, limit_s: float = 60.0) -> None:
        """Run until that is so."""
        end_ns = self.line.now_ns() + round(limit_s * 1e9)
        while not true():
            assert self.line.now_ns() < end_ns, f"{what}: still {self.state.name} after {limit_s} s"
            self._once(end_ns)

    def run(self, milliseconds: float) -> None:
        """Let time go by."""
        end_ns = self.line.now_ns() + round(milliseconds * MS)
        while self.line.now_ns() < end_ns:
            self._once(end_ns)

    def _once(self, end_ns: int) -> None:
        now_ns = self.line.now_ns()
        if now_ns >= self._next_ns:
            self._next_ns = max(self._next_ns + TICK_NS, now_ns)
            if self.speaks:
                self.bridge.begin_tick(now_ns)
                self._send(self.bridge.tick(self.decision, now_ns - 20 * MS, (True, True, True), 7, now_ns))
        frame = self.line.receive(min(self._next_ns, end_ns))
        if frame is not None:
            self._hear(frame)

    def _send(self, frames: list[Frame]) -> None:
        for frame in frames:
            self.line.send(frame)

    def _hear(self, frame: Frame) -> None:
        message = self.wire.decode(frame)
        if not isinstance(message, Decoded):
            return
        answers = self.bridge.on_message(message.name, message.signals, message.counter, self.line.now_ns())
        if self.speaks:
            self._send(answers)
        if message.name == "CTRL_STATUS":
            self.state = State(frame.data[3] & 0xF)
            self.assist_zero = bool(frame.data[7] >> 6 & 1)

    def is_in(self, *states: State) -> Callable[[], bool]:
        return lambda: self.state in states

    def assists(self) -> bool:
        """In ASSIST, with torque."""
        return self.state is State.ASSIST and not self.assist_zero
