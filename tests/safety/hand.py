"""A bridge worked by hand: each frame to the device is made one at a time, so that any one condition can be broken."""

from __future__ import annotations

from dataclasses import replace

from firmware_sim import e2e, frames, secoc
from firmware_sim.memory import ControllerState, Inputs, Received
from firmware_sim.states import State
from tests.safety.stepping import PATIENCE_TICKS, Outputs, step

KEY = secoc.DEMO_KEY
BOOT_NONCE = 0x0B007B00
BRIDGE_NONCE = 0x11223344
DEVICE_NONCE = 0x55667788
TAKE, PUT, MOVE_AROUND, POUR = 1, 2, 5, 10


class Hand:
    """Holds the device, its clock and the counters of each message sent to it."""

    def __init__(self, state: ControllerState | None = None) -> None:
        self.state = state or ControllerState(KEY, BOOT_NONCE)
        self.now_ms = self.state.last_tick_ms
        self.ticks_left = PATIENCE_TICKS
        self.inputs = Inputs(velocity_mdeg_s=20_000, random_u32=DEVICE_NONCE)
        self.outputs = Outputs((), 0, 0, 0)
        self.counters: dict[int, int] = {}
        self.freshness = 0
        self.session = 0
        self.key = b""
        self.last_status = 0
        self.status_counter = 0
        self.log: list[tuple[int, bytes]] = []

    # time

    def tick(self, *received: Received, **changes: object) -> Outputs:
        """One millisecond with these frames. A test that waits for what never comes fails, also of a mutant."""
        self.now_ms += 1
        self.ticks_left -= 1
        assert self.ticks_left > 0
        self.state, self.outputs = step(self.state, replace(self.inputs, frames=received, **changes), self.now_ms)
        for can_id, data in self.outputs.frames:
            self.log.append((can_id, data))
            if can_id == frames.CTRL_STATUS:
                self.status_counter = data[2]
        return self.outputs

    def run(self, milliseconds: int, **changes: object) -> Hand:
        """Time without frames."""
        for _ in range(milliseconds):
            self.tick(**changes)
        return self

    # frames

    def frame(self, can_id: int, values: tuple[int, ...], counter: int | None = None) -> Received:
        """A protected frame; the counter goes on by itself unless given."""
        if counter is None:
            counter = (self.counters.get(can_id, 0) + 1) & 0xFF
            self.counters[can_id] = counter
        return Received(can_id, e2e.protect(can_id, frames.pack(can_id, values), counter))

    def act_cmd(
        self,
        gate: int,
        verb: int = 0,
        *,
        session: int | None = None,
        echo: int | None = None,
        age: int = 10,
        counter: int | None = None,
    ) -> Received:
        """An ACT_CMD; session and echo are the right ones unless given. `age` in the wire's 2 ms."""
        session = self.session if session is None else session
        echo = self.status_counter if echo is None else echo
        return self.frame(frames.ACT_CMD, (gate, verb, 90, session, echo, age), counter)

    def hold(self, **fields: int) -> Received:
        """A HOLD."""
        return self.act_cmd(frames.GATE_HOLD, **fields)

    def auth(self, act_cmd: Received, *, freshness: int | None = None, key: bytes | None = None) -> Received:
        """The ACT_AUTH of an ACT_CMD."""
        if freshness is None:
            self.freshness += 1
            freshness = self.freshness
        mac = secoc.act_mac(key or self.key or bytes(16), self.session, freshness, act_cmd.data)
        return self.frame(frames.ACT_AUTH, (freshness & 0xFF, mac))

    def act(self, verb: int = TAKE, **fields: int) -> tuple[Received, Received]:
        """An ACT with its authorisation."""
        command = self.act_cmd(frames.GATE_ACT, verb, **fields)
        return command, self.auth(command)

    def heartbeat(self, version: int = frames.PROTOCOL_VERSION) -> Received:
        """A BRIDGE_HB."""
        return self.frame(frames.BRIDGE_HB, (7, 1, 0, 7, version))

    def request(self, purpose: int = frames.PURPOSE_ARM, nonce: int = BRIDGE_NONCE) -> Received:
        """An ARM_REQUEST."""
        return self.frame(frames.ARM_REQUEST, (nonce, purpose))

    def response(
        self, purpose: int = frames.PURPOSE_ARM, *, session: int | None = None, shared: bytes = KEY
    ) -> Received:
        """The right ARM_RESPONSE to the challenge that is open, unless told otherwise."""
        number = self.state.last_session if session is None else session
        self.session_key = secoc.session_key(shared, BRIDGE_NONCE, DEVICE_NONCE, BOOT_NONCE, number)
        mac = secoc.arm_mac(self.session_key, purpose, number, BRIDGE_NONCE, DEVICE_NONCE)
        return self.frame(frames.ARM_RESPONSE, (mac, number))

    # ways

    def to_follow(self) -> Hand:
        """Through BOOT and SELFTEST."""
        for _ in range(200):
            if self.state.state in (State.BOOT, State.SELFTEST):
                self.tick()
        assert self.state.state == State.FOLLOW
        return self

    def arm(self) -> Hand:
        """A whole handshake."""
        self.tick(self.request())
        self.tick(self.response())
        assert self.state.armed
        self.session, self.key, self.freshness = self.state.session, self.session_key, 0
        return self

    def beat(self, *received: Received, milliseconds: int = 40) -> Hand:
        """One period of the bridge: these frames and a heartbeat, then silence."""
        self.tick(*received, self.heartbeat())
        return self.run(milliseconds - 1)

    def to_ready(self) -> Hand:
        """Armed and held until READY."""
        self.to_follow().arm()
        for _ in range(8):
            if self.state.state == State.READY:
                return self
            self.beat(self.hold())
        raise AssertionError(f"not READY but {self.state.state.name}")

    def to_assist(self, verb: int = TAKE, periods: int = 10) -> Hand:
        """Assisting, with torque."""
        self.to_ready()
        for _ in range(periods):
            self.beat(*self.act(verb))
        assert self.state.state == State.ASSIST
        assert self.outputs.assist_unm != 0
        return self

    def until_zero(self, limit_ms: int = 400) -> int:
        """Ticks without frames until assist is exactly zero."""
        for elapsed in range(limit_ms):
            if self.outputs.assist_unm == 0:
                return elapsed
            self.tick()
        raise AssertionError("assist never reached zero")

    def count(self, why: frames.Reject | int) -> int:
        """A DIAG counter."""
        return self.state.counters[int(why)]
