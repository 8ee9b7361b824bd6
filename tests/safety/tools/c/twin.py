"""The C controller against the reference: random sequences through both, every number of state and outputs after each tick.

A sequence is a bridge that arms, holds and acts, over an arm that moves; chance makes wrong what can be wrong: frames,
clocks, sensors, motor, transceiver, hands. How wild a sequence is, is drawn once for it, so that many go deep.
"""

from __future__ import annotations

import math
import random
from collections import Counter
from typing import TypeVar

from firmware_sim import e2e, frames, secoc
from firmware_sim.c import binding
from firmware_sim.c.flat import Flattener, flat
from firmware_sim.controller import advance
from firmware_sim.memory import ControllerState, Inputs, Received
from firmware_sim.states import State
from firmware_sim.watchdogs import Limits
from tests.safety.hand import BRIDGE_NONCE, DEVICE_NONCE, KEY, Hand
from tests.safety.table import Row, Scale
from tests.safety.tools.c.scrambled import scramble

_WILDNESS = (0.0, 0.002, 0.002, 0.02, 0.2)
_LENGTHS = (800, 800, 800, 1200, 2500)
_IDS = (
    *frames.RECEIVED_IDS,
    *frames.RECEIVED_IDS,
    *frames.RECEIVED_IDS,
    *frames.OWN_IDS,
    frames.STOP,
    0x7FF,
    0x18FF0060,
)
_EXTREMES = (-(2**31), 2**31 - 1, 0, 200_001, -40_001, 700_000)
# What lasts, from some moment of a sequence on: no heartbeat, a stuck motor, an arm that leaves its range, commands between
# an ACT and its authorisation, encoders apart for some ticks, a session as old as its freshness allows.
_LASTING = (
    "",
    "",
    "",
    "heartless",
    "stuck",
    "adrift",
    "pairs",
    "flood",
    "guesses",
    "apart",
    "old",
    "scrambled",
    "scrambled",
    "scrambled",
)
_READINGS = ("angle_mdeg", "second_angle_mdeg", "velocity_mdeg_s", "user_torque_unm", "measured_unm", "commanded_unm")


class Differs(AssertionError):
    """The two are not the same after a tick."""


class Twin(Hand):
    """Both controllers under one hand, each stepped in place."""

    def __init__(self, rng: random.Random) -> None:
        limits = (
            Limits() if rng.random() < 0.8 else Limits(-20_000, 160_000, rng.randint(1, 600_000), rng.randint(1, 10**6))
        )
        nonce = rng.getrandbits(32)
        super().__init__(ControllerState(KEY, nonce, limits))
        self.c = binding.CController(KEY, nonce, limits)
        self.rng = rng
        self.flattener = Flattener()
        self.seen: Counter[State] = Counter()
        self.past: list[Received] = []
        self.wild = rng.choice(_WILDNESS)
        self.speed = rng.choice((0, 3_000, 20_000, 60_000, 200_000))
        self.tremor = rng.choice((0, 0, 30_000, 90_000))
        self.angle = 30_000.0
        self.verb = rng.randrange(32) if rng.random() < 0.3 else rng.choice((1, 3, 4, 6, 10, 15))
        self.off = self.steady = False
        self.lasting = rng.choice(_LASTING)
        self.since_ms = rng.randrange(200, 900)
        if self.lasting == "scrambled":
            self.wild, self.tremor = 0.0, rng.choice((0, 90_000))

    def calm(self) -> None:
        """A sequence in which nothing goes wrong but an ACT that never ends."""
        self.wild, self.lasting, self.verb, self.steady = 0.0, "", 4, True

    def _lasts(self, what: str) -> bool:
        return self.lasting == what and self.now_ms >= self.since_ms

    def go(self, ticks: int) -> None:
        """So many ticks of one sequence. Raises Differs."""
        for _ in range(ticks):
            if self.lasting == "old" and self.now_ms == self.since_ms:
                self.freshness = self.state.freshness = 2**32 - 3
                self._changed()
            received, read = self._arriving(), self._inputs()
            if self._lasts("scrambled") and self.rng.random() < 0.1:
                scramble(self.rng, self.state.torque, read, self.verb)
                self._changed()
            self._once(received, read)

    def _changed(self) -> None:
        """The reference's state was changed from outside: the C gets it, too."""
        self.c.load(flat(self.state))

    def _once(self, received: tuple[Received, ...], inputs: Inputs) -> None:
        late = self.rng.random() < self.wild * 0.05
        self.now_ms += self.rng.choice((2, 4, 5, 6, 40, 300)) if late else 1
        inputs.frames = received
        self._both(inputs)
        for can_id, data in self.state.outbox:
            if can_id == frames.CTRL_STATUS:
                self.status_counter = data[2]
        if self.state.armed and self.state.session != self.session:
            self.session, self.key, self.freshness = self.state.session, self.state.key, 0
        self.seen[self.state.state] += 1

    def _both(self, inputs: Inputs) -> None:
        advance(self.state, inputs, self.now_ms)
        self.c.advance(inputs, self.now_ms)
        place = self.c.differs(self.flattener(self.state))
        if place != -1:
            raise Differs(
                f"tick {self.now_ms}, number {place}: {flat(self.state)[place]} here, {self.c.dump()[place]} in C"
            )

    def _inputs(self) -> Inputs:
        """An arm that swings as its sequence does, and what sensors, motor and hands may make of it."""
        rng, at_s = self.rng, self.now_ms / 1000
        velocity = self.speed * math.sin(at_s) + self.tremor * math.sin(36 * at_s) if self.now_ms > 1 else 0.0
        low, high = (-30_000, 190_000) if self._lasts("adrift") else (5_000, 140_000)
        if not low < self.angle + velocity / 1000 < high:
            self.speed = -self.speed
            velocity = 0.0
        before, self.angle = round(self.angle), self.angle + velocity / 1000
        angle = round(self.angle)
        commanded = self.state.torque.assist_unm
        read = Inputs(
            angle_mdeg=angle,
            second_angle_mdeg=angle,
            velocity_mdeg_s=(angle - before) * 1000 if abs(velocity) > 25_000 else round(velocity),
            user_torque_unm=round(2e6 * math.sin(3 * at_s)) if self.tremor else -self.speed * 10,
            measured_unm=commanded,
            commanded_unm=commanded,
            random_u32=DEVICE_NONCE if rng.random() < 0.9 else rng.getrandbits(32),
            bus_off=self.off,
            self_test_ok=self.wild < 0.1 or rng.random() < 0.9,
        )
        if self._lasts("stuck"):
            read.measured_unm += 1_100_000
        if self._lasts("apart") and self.now_ms < self.since_ms + 5:
            read.second_angle_mdeg += 4_000
        if rng.random() < self.wild:
            self._spoil(read)
        return read

    def _spoil(self, read: Inputs) -> None:
        rng = self.rng
        match rng.randrange(7):
            case 0:
                setattr(read, rng.choice(_READINGS), rng.choice(_EXTREMES))
            case 1:
                name = rng.choice(_READINGS)
                setattr(read, name, getattr(read, name) + rng.choice((1, -1)) * 10 ** rng.randrange(8))
            case 2:
                self.off = not self.off
            case 3:
                read.stall_ticks, read.tx_dropped = rng.choice((1, 7, 2**32 - 1)), rng.choice((0, 3, 2**31))
            case 4:
                read.local_clear = True
            case 5:
                self.speed = rng.choice((0, 9_000, 120_000, 500_000))
            case _:
                read.measured_unm += rng.choice((400_000, 600_001, -5_000_000))

    def _arriving(self) -> tuple[Received, ...]:
        rng, phase = self.rng, self.now_ms % 40
        sent: list[Received] = []
        if phase == 0:
            sent = self._honest()
        elif phase == 20 and self.state.state in (State.LATCHED, State.ESTOP) and rng.random() < 0.5:
            sent = [self.request(frames.PURPOSE_CLEAR_LATCH), *self._response(frames.PURPOSE_CLEAR_LATCH)]
        while rng.random() < self.wild:
            sent.insert(rng.randrange(len(sent) + 1), self._stranger())
        if self.wild == 0.2 and rng.random() < 0.001:
            sent += [self.request() for _ in range(40)]  # more than the outbox holds
        self.past = [*self.past, *sent][-60:] if sent else self.past
        return tuple(sent)

    def _honest(self) -> list[Received]:
        """One period of a bridge: arms where it can, then holds, then acts; forgets something now and then."""
        rng, state = self.rng, self.state
        sent = [] if rng.random() < self.wild or self._lasts("heartless") else [self.heartbeat()]
        if not state.armed and state.state in (State.FOLLOW, State.READY):
            return [*sent, self.request(), *self._response(frames.PURPOSE_ARM)]
        if rng.random() < self.wild * 2:
            return sent
        if state.state in (State.READY, State.ASSIST) and (self.steady or rng.random() < 0.97):
            if not self.steady and rng.random() < 0.01:
                self.verb = rng.randrange(32)
            verb = self.verb if self.verb in frames.VERB_CODES else 31
            command = self.act_cmd(frames.GATE_ACT, verb, **self._odd())
            authorised = [] if rng.random() < self.wild else [self._authorised(command)]
            between = {"pairs": 1, "flood": rng.choice((3, 4, 6))}.get(self.lasting, 0) if rng.random() < 0.2 else 0
            return [
                *sent,
                command,
                *(self.act_cmd(frames.GATE_ACT, 4) for _ in range(between)),
                *self._guesses(),
                *authorised,
            ]
        return [*sent, self.hold(**self._odd())]

    def _guesses(self) -> list[Received]:
        """More than one MAC for a tick: authorisations, and a handshake now and then."""
        if not self._lasts("guesses") or self.rng.random() > 0.1:
            return []
        mac = [self.frame(frames.ACT_AUTH, (0, self.rng.getrandbits(32))) for _ in range(self.rng.randrange(3))]
        return [self.request(), *self._response(frames.PURPOSE_ARM), *mac] if self.rng.random() < 0.3 else mac

    def _odd(self) -> dict[str, int]:
        """Fields of a command that are not what they should be, rarely."""
        rng = self.rng
        if rng.random() >= self.wild * 2:
            return {}
        return rng.choice(
            ({"session": rng.randrange(256)}, {"echo": rng.randrange(256)}, {"age": rng.randrange(256)},
             {"counter": rng.randrange(256)}, {"age": 75}, {"age": 76})
        )  # fmt: skip

    def _authorised(self, command: Received) -> Received:
        if self.rng.random() < self.wild:
            freshness = min(2**32 - 1, self.rng.choice((2**32 - 1, self.freshness, self.freshness + 300)))
            return self.auth(command, freshness=freshness, key=self.rng.choice((None, bytes(16))))
        self.freshness = min(self.freshness, 2**32 - 2)
        return self.auth(command)

    def _response(self, purpose: int) -> list[Received]:
        """The answer to the challenge that this request will get, as in `Hand.response`, with this boot's nonce."""
        number = self.state.last_session % 255 + 1
        shared = KEY if self.rng.random() >= self.wild else bytes(16)
        key = secoc.session_key(shared, BRIDGE_NONCE, DEVICE_NONCE, self.state.boot_nonce, number)
        mac = secoc.arm_mac(key, purpose, number, BRIDGE_NONCE, DEVICE_NONCE)
        return [self.frame(frames.ARM_RESPONSE, (mac, number))]

    def _stranger(self) -> Received:
        """One frame that no honest bridge sends just now."""
        rng = self.rng
        can_id = rng.choice(_IDS)
        match rng.randrange(8):
            case 0:
                return Received(can_id, rng.randbytes(rng.choice((8, 8, 8, 0, 3, 7, 64, 300))), rng.random() < 0.9)
            case 1 | 2 if self.past:
                return rng.choice(self.past)
            case 3:
                return self.request(rng.choice((1, 2)), rng.choice((BRIDGE_NONCE, 7)))
            case 4:
                return self.act_cmd(rng.choice((1, 2)), rng.choice((0, 1, 4, 10, 31)), **self._odd())
            case 5:
                return self.heartbeat(rng.randrange(1, 4))
            case 6 if rng.random() < 0.05:
                return Received(rng.choice((frames.STOP, *frames.OWN_IDS)), b"", rng.random() < 0.8)
            case _:
                can_id = rng.choice(frames.RECEIVED_IDS)
                counter = self.counters.get(can_id, 0) + rng.choice((0, 1, 1, 1, 2, 5))
                self.counters[can_id] = counter & 0xFF
                return Received(can_id, e2e.protect(can_id, rng.randbytes(8), counter))


AnyTwin = TypeVar("AnyTwin", bound=Twin)


def sequence_of(kind: type[AnyTwin], seed: int, number: int) -> tuple[AnyTwin, int]:
    """What a sequence of that number is, and how many ticks it has."""
    rng = random.Random(seed * 1_000_003 + number)
    twin = kind(rng)
    length = rng.choice(_LENGTHS)
    if number % 200 == 0:
        twin.calm()
        length = 14_000
    return twin, length


def _sequence(seed: int, number: int) -> tuple[Twin, str | None]:
    """One sequence from its number, and where the two differ."""
    twin, length = sequence_of(Twin, seed, number)
    try:
        twin.go(length)
    except Differs as differs:
        return twin, f"sequence {number}, {differs}"
    return twin, None


def run(scale: Scale) -> list[Row]:
    """So many sequences; where there is no C, that is said and does not hold."""
    claim = "every number of state and outputs is the same in C, after every tick"
    if (why := binding.why_not()) is not None:
        return [Row("twin", claim, f"the C controller is {why}", False)]
    sequences = scale.of(10_000, 40)
    ticks, seen, wrong = 0, Counter[State](), []
    for number in range(sequences):
        twin, differs = _sequence(scale.seed, number)
        if differs is not None:
            wrong.append(differs)
        ticks += sum(twin.seen.values())
        seen += twin.seen
    after = [state for state in State if state is not State.BOOT]  # which no tick ends in
    states = ", ".join(f"{state.name} {seen[state]}" for state in after)
    figure = f"{sequences} sequences, {ticks} ticks, {len(wrong)} differ" + (f": {wrong[0]}" if wrong else "")
    return [
        Row("twin", claim, figure, not wrong),
        Row("twin", "every state is among them", states, all(seen[state] for state in after)),
    ]
