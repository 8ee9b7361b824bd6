"""The tester: a bridge worked by hand over a line, each frame its own, so that any one condition of the contract can be broken.

It keeps the bridge's rhythm by itself (`wish`, `beats`) and leaves the rest to the cases. Time is the line's.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from enum import Enum
from typing import NamedTuple

from hilbridge.conformance.findings import Unshown
from hilbridge.conformance.hearing import Hearing, shows_assist
from hilbridge.conformance.line import Line
from hilbridge.core.session import Crypto
from hilbridge.limits import AGE_STEP_MS, CHALLENGE_WAIT_NS, MS, PROTOCOL_VERSION, TICK_NS
from hilbridge.records import Frame
from hilbridge.wire.codec import Codec
from hilbridge.wire.dbc import Value
from hilbridge.wire.e2e import protect

VERB, OTHER_VERB = "Pour", "Operate"
_BEAT_NS = 80 * MS
_STATUS_WAIT_MS = 300.0
_ANSWER_LIMIT_MS = CHALLENGE_WAIT_NS / MS


class Silence(Enum):
    """No command at all, as of a bridge that hangs."""

    SILENT = "silent"


SILENT = Silence.SILENT
HOLD = "Hold"


class Setting(NamedTuple):
    """What a tester is given. `press` starts somebody's hand at the device and returns at once; None: there is none."""

    crypto: Crypto
    chance: random.Random
    margin_ms: float = 5.0
    phases: int = 10
    press: Callable[[], None] | None = None
    patience_ms: float = 3_000.0  # for the hand


class ByHand:
    """`wish` is what goes out every 40 ms: HOLD, a verb (an ACT with its MAC), or SILENT; `fields` lie over its signals."""

    def __init__(self, line: Line, codec: Codec, setting: Setting) -> None:
        self.line, self.codec, self.setting = line, codec, setting
        self.hearing = Hearing(codec)
        self.wish: str | Silence = SILENT
        self.fields: dict[str, Value] = {}
        self.alter: Callable[[Frame], list[Frame]] = lambda frame: [frame]  # a command on its way out
        self.beats = True
        self.session, self.key, self.freshness = 0, b"", 0
        self.sent: list[Frame] = []
        self.last_act_ns = 0  # of the last ACT that was authorised
        self.skipped = 0  # of a case that jumps
        self._counters: dict[str, int] = {}
        self._command_ns = self._beat_ns = line.now_ns()

    # Frames

    def frame(self, name: str, signals: Mapping[str, Value], counter: int | None = None) -> Frame:
        """The next protected frame of a message; or one with a counter of its own, which moves nothing."""
        if counter is None:
            counter = self._counters[name] = (self._counters.get(name, 0) + 1) & 0xFF
        layout = self.codec.messages[name]
        assert layout.data_id is not None
        return Frame(layout.can_id, protect(self.codec.encode(name, signals), layout.data_id, counter))

    def command(self, wish: str, **fields: Value) -> Frame:
        """An ACT_CMD: HOLD, or the verb to act with."""
        status = self.hearing.newest.get("CTRL_STATUS")
        signals: dict[str, Value] = {
            "Gate": "Hold" if wish == HOLD else "Act",
            "Verb": "None" if wish == HOLD else wish,
            "Confidence": 90,
            "Session": self.session,
            "Echo": 0 if status is None else status.counter,
            "SensingAge": 10 * AGE_STEP_MS,
        }
        return self.frame("ACT_CMD", {**signals, **self.fields, **fields})

    def authorisation(self, act: Frame, *, flip: int = 0) -> Frame:
        """The ACT_AUTH of an ACT_CMD; `flip` are bits of the MAC to turn over."""
        self.freshness += 1
        mac = self.setting.crypto.act_mac(self.key, self.session, self.freshness, act.data)
        return self.frame("ACT_AUTH", {"Freshness": self.freshness & 0xFF, "Mac": mac ^ flip})

    def send(self, *frames: Frame) -> int:
        """Send now; returns when."""
        at_ns = self.line.now_ns()
        for frame in frames:
            self.line.send(frame)
            self.sent.append(frame)
        return at_ns

    def act(self, verb: str = VERB, **fields: Value) -> int:
        """One ACT with its authorisation."""
        command = self.command(verb, **fields)
        self.last_act_ns = self.send(command, self.authorisation(command))
        return self.last_act_ns

    # Time

    def run(self, milliseconds: float) -> None:
        """Let time go by in the bridge's rhythm."""
        end_ns = self.line.now_ns() + round(milliseconds * MS)
        while self.line.now_ns() < end_ns:
            self._turn(end_ns)

    def until(self, holds: Callable[[], bool], limit_ms: float) -> bool:
        """Run until it holds; False where it does not in time."""
        end_ns = self.line.now_ns() + round(limit_ms * MS)
        while not holds():
            if self.line.now_ns() >= end_ns:
                return False
            self._turn(end_ns)
        return True

    def _turn(self, end_ns: int) -> None:
        now_ns = self.line.now_ns()
        if now_ns >= self._command_ns:
            self._command_ns = max(self._command_ns + TICK_NS, now_ns + TICK_NS // 2)
            self._speak()
        if self.beats and now_ns >= self._beat_ns:
            self._beat_ns = max(self._beat_ns + _BEAT_NS, now_ns + _BEAT_NS // 2)
            self.send(self.heartbeat())
        frame = self.line.receive(min(end_ns, self._command_ns, self._beat_ns if self.beats else end_ns))
        if frame is not None:
            self.hearing.take(frame)

    def _speak(self) -> None:
        if isinstance(self.wish, Silence):
            return
        command = self.command(self.wish)
        altered = self.alter(command)
        authorised = [self.authorisation(command)] if self.wish != HOLD and altered else []
        at_ns = self.send(*altered, *authorised)
        if authorised:
            self.last_act_ns = at_ns

    def heartbeat(self) -> Frame:
        """A BRIDGE_HB."""
        signals: dict[str, Value] = {"SensorValid": 7, "BridgeState": "Running", "ProtocolVersion": PROTOCOL_VERSION}
        return self.frame("BRIDGE_HB", signals)

    def next_command_in(self, milliseconds: float) -> None:
        """Move the rhythm: the next command goes out so much later."""
        self._command_ns = self.line.now_ns() + round(milliseconds * MS)

    # What the device counts

    def counts(self, *names: str) -> dict[str, int]:
        """Values of CTRL_DIAG told from now on. Raises Unshown where they do not come within a round."""
        asked_ns = self.line.now_ns()
        told = self.hearing.diag

        def all_new() -> bool:
            return all(name in told and told[name][0] >= asked_ns for name in names)

        if not self.until(all_new, 2_500.0):
            raise Unshown(f"CTRL_DIAG does not tell {', '.join(names)} within 2.5 s")
        return {name: told[name][1] for name in names}

    # Ways

    def greet(self) -> None:
        """Bring the device's E2E counters into step with ours: a bridge of before may have used these very numbers.

        Nothing of it means anything: holds, a question that is not answered, an answer to none, a MAC of no command.
        """
        self.plain()
        self.run(200.0)
        nonce = self.setting.chance.getrandbits(32)
        for _ in range(2):
            self.ask("Arm", nonce)
        self.run(520.0)
        for _ in range(2):
            self.send(self.frame("ARM_RESPONSE", {"Mac": 0, "Session": 1}))
            self.send(self.frame("ACT_AUTH", {"Freshness": 0, "Mac": 0}))
            self.run(40.0)

    def plain(self) -> None:
        """Forget what the last case has bent."""
        self.fields, self.beats = {}, True
        self.alter = lambda frame: [frame]
        if self.wish is SILENT:
            self._command_ns = self.line.now_ns()
        self.wish = HOLD

    def to_follow(self) -> None:
        """Present, not latched, not armed by this tester yet. Raises Unshown."""
        self.plain()
        if not self.until(lambda: {"CTRL_STATUS", "CTRL_HB"} <= self.hearing.newest.keys(), _STATUS_WAIT_MS):
            raise Unshown("the device tells neither state nor boot nonce within 300 ms")
        if self.hearing.stopped:
            self.clear()
        if not self.until(lambda: self.hearing.state in ("Follow", "Ready", "Assist", "RampDown"), 2_000.0):
            raise Unshown(f"the device stays in {self.hearing.state} ({self.hearing.reason})")
        self.until(lambda: self.hearing.state in ("Follow", "Ready"), 1_000.0)

    def handshake(self, purpose: str, *, flip: int = 0, wait_ms: float = 0.0) -> bool:
        """Request, challenge, response; False where no challenge came within 300 ms."""
        nonce = self.setting.chance.getrandbits(32)
        challenge = self.ask(purpose, nonce)
        if challenge is None:
            return False
        self.run(wait_ms)
        self.answer(purpose, nonce, challenge, flip=flip)
        return True

    def ask(self, purpose: str, nonce: int) -> tuple[int, int] | None:
        """Send an ARM_REQUEST; the challenge's nonce and session number."""
        asked_ns = self.send(self.frame("ARM_REQUEST", {"BridgeNonce": nonce, "Purpose": purpose}))
        newest = self.hearing.newest

        def challenged() -> bool:
            return "ARM_CHALLENGE" in newest and newest["ARM_CHALLENGE"].at_ns >= asked_ns

        if not self.until(challenged, _ANSWER_LIMIT_MS):
            return None
        signals = newest["ARM_CHALLENGE"].signals
        return int(signals["DeviceNonce"]), int(signals["Session"])

    def answer(self, purpose: str, nonce: int, challenge: tuple[int, int], *, flip: int = 0) -> None:
        """Send the ARM_RESPONSE to a challenge; remembers the session's key."""
        device_nonce, number = challenge
        crypto = self.setting.crypto
        boot_nonce = int(self.hearing.newest["CTRL_HB"].signals["BootNonce"])
        key = crypto.session_key(nonce, device_nonce, boot_nonce, number)
        mac = crypto.arm_mac(key, purpose, number, nonce, device_nonce)
        if purpose == "Arm" and not flip:
            self.session, self.key, self.freshness = number, key, 0
        self.send(self.frame("ARM_RESPONSE", {"Mac": mac ^ flip, "Session": number}))

    def arm(self) -> None:
        """A session of this tester's. Raises Unshown."""
        self.to_follow()
        for _ in range(3):  # a rest after a disturbed handshake, or a boot that takes longer
            if self.handshake("Arm") and self.until(lambda: self.hearing.session == self.session != 0, 200.0):
                return
            self.run(550.0)
        raise Unshown("the device does not arm; is its key this one?")

    def to_ready(self) -> None:
        """Armed and READY. Raises Unshown."""
        self.plain()
        self.run(25.0)  # what a silence before this has begun shows now
        if self.hearing.state != "Ready" or self.hearing.session != self.session:
            self.arm()
        if not self.until(lambda: self.hearing.state == "Ready", 600.0):
            raise Unshown(f"armed and held, yet not Ready but {self.hearing.state} ({self.hearing.reason})")

    def to_assist(self, verb: str = VERB) -> None:
        """Assisting, with torque at this moment. Raises Unshown."""
        if self.hearing.state != "Assist" or self.wish != verb:
            self.to_ready()
            self.wish = verb
        if not self.until(lambda: self.hearing.state == "Assist", 300.0):
            raise Unshown(f"authorised ACTs, yet not Assist but {self.hearing.state} ({self.hearing.reason})")
        began_ns = self.line.now_ns()

        def torque() -> bool:
            return self.hearing.state != "Assist" or any(map(shows_assist, self.hearing.since(began_ns)[-1:]))

        if not self.until(torque, 8_000.0) or self.hearing.state != "Assist":
            raise Unshown("no assist torque in 8 s of Assist; move the joint while the test runs")

    def clear(self) -> None:
        """Out of a latch or stop, by all four things it takes. Raises Unshown."""
        self.plain()
        if self.setting.press is None:
            raise Unshown("the device is stopped and nobody clears it; give --clear-command, or a terminal")
        if not self.until(lambda: self.hearing.at_rest, 1_500.0):
            raise Unshown("the stopped device keeps its torque")
        for _ in range(2):
            self.handshake("ClearLatch")
            self.run(60.0)
            self.setting.press()
            if self.until(lambda: not self.hearing.stopped, self.setting.patience_ms):
                return
        raise Unshown(f"the device stays {self.hearing.state} although it was held, authenticated and confirmed")

    def anew(self) -> None:
        """Cleared just now: no trips and no MAC failures are remembered. Raises Unshown."""
        self.to_follow()
        self.stop()
        if not self.until(lambda: self.hearing.stopped, 100.0):
            raise Unshown("STOP does not stop it, so that nothing can be cleared")
        self.clear()
        self.until(lambda: self.hearing.state == "Follow", 500.0)

    def stop(self) -> int:
        """STOP, once; returns when."""
        return self.send(Frame(self.codec.messages["STOP"].can_id, b""))
