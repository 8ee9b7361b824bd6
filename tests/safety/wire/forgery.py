"""An adversary who knows everything but the key: random ACT and AUTH pairs that pass every plain check."""

from __future__ import annotations

import random

from firmware_sim import e2e, frames
from firmware_sim.memory import Received
from firmware_sim.receive import receive
from firmware_sim.states import Reason, State
from tests.safety.hand import Hand
from tests.safety.stepping import copied
from tests.safety.table import Row, Scale

ASSISTED = [code for code in range(1, 22) if code != 5]


def pairs(count: int, seed: int) -> Row:
    """`count` forged pairs, each against a READY device that has seen no forgery yet."""
    rng = random.Random(seed)
    hand = Hand().to_ready()
    state, now_ms = hand.state, hand.now_ms + 1
    act_counter = (state.receivers[0].counter or 0) + 1
    accepted = pending = failures = 0
    for _ in range(count):
        victim = copied(state)
        values = (2, rng.choice(ASSISTED), rng.randrange(101), state.session, hand.status_counter, rng.randrange(76))
        act = e2e.protect(frames.ACT_CMD, frames.pack(frames.ACT_CMD, values), act_counter)
        receive(victim, Received(frames.ACT_CMD, act), 0, now_ms)
        pending += victim.pending is not None
        forged = frames.pack(frames.ACT_AUTH, (rng.randrange(256), rng.getrandbits(32)))
        auth = e2e.protect(frames.ACT_AUTH, forged, rng.randrange(256))
        receive(victim, Received(frames.ACT_AUTH, auth), 0, now_ms)
        accepted += victim.state != State.READY or victim.command_ms != state.command_ms
        failures += victim.mac_failures
    return Row(
        "forgery",
        "random ACT + AUTH pairs, all plain checks passed: accepted",
        f"{count} pairs, {accepted} accepted, {failures} counted as MAC failures",
        accepted == 0 and pending == count and failures == count,
    )


def latch(seeds: int) -> Row:
    """The third forgery latches, whatever the forgeries are."""
    latched = 0
    for seed in range(seeds):
        rng, hand = random.Random(seed), Hand().to_ready()
        for k in range(3):
            command = hand.act_cmd(frames.GATE_ACT, rng.choice(ASSISTED))
            hand.beat(command, hand.frame(frames.ACT_AUTH, (rng.randrange(256), rng.getrandbits(32))), milliseconds=12)
            if k < 2 and hand.state.state == State.LATCHED:
                break
        latched += hand.state.state == State.LATCHED and hand.state.reason == Reason.MAC_FAILURES
    return Row("forgery", "three failures latch", f"{latched} of {seeds}", latched == seeds)


def run(scale: Scale) -> list[Row]:
    """All of it."""
    return [pairs(scale.of(1_000_000, 10_000), scale.seed), latch(scale.of(1000, 20))]
