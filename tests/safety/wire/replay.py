"""Replay, doubled frames, and queues of a dead bridge: nothing old is ever accepted, and no duplicate feeds a deadline."""

from __future__ import annotations

import random
from itertools import pairwise, product

from firmware_sim import e2e, frames
from firmware_sim.memory import ControllerState, Received
from firmware_sim.receive import receive
from firmware_sim.states import State
from tests.safety.hand import POUR, Hand
from tests.safety.rig import ACT_POUR, ACT_TAKE, HOLD, Rig
from tests.safety.stepping import copied
from tests.safety.table import Row, Scale

QUEUE = 512
COMMANDS = (frames.ACT_CMD, frames.ACT_AUTH)


def doubled() -> Row:
    """Every frame of both directions twice: the system works, and the second copy is never accepted."""
    rig = Rig()
    fed: list[tuple[int, int]] = []
    rig.to_device = lambda frame: [frame, frame]
    rig.to_bridge = lambda frame: [frame, frame]
    rig.until("READY")
    rig.decision = ACT_TAKE
    accepted_before = rig.state.counters[0]
    sent_before = len(rig.sent)
    for _ in range(4000):
        rig.tick()
        fed.append((rig.state.command_ms, rig.state.accepted_counter))
    sent = [frame for frame in rig.sent[sent_before:] if frame.can_id != frames.ACT_CMD]
    accepted = rig.state.counters[0] - accepted_before
    # An ACT counts once, with its ACT_AUTH; doubled frames are all refused as repeated.
    repeated = rig.state.counters[int(frames.Reject.REPEATED)]
    assisted = rig.state.state == State.ASSIST
    once = len(set(fed)) == len({ms for ms, _ in fed})
    holds = accepted == len(sent) and repeated >= len(rig.sent) - 2 and assisted and once
    return Row(
        "replay",
        "every frame doubled: no duplicate accepted, none feeds a deadline",
        f"{len(sent)} accepted of {len(sent)} sent, {repeated} duplicates refused",
        holds,
    )


def _made_while_stuck(hand: Hand, period_ms: int, holds: bool) -> list[Received]:
    """512 commands of the live session, each right for the moment it was made, none of which got out."""
    counter, echo, made = hand.counters[frames.ACT_CMD], hand.status_counter, []
    for k in range(QUEUE // 2):
        moment_echo = (echo + k * period_ms // 20) & 0xFF
        if holds and k % 10 < 4:
            made.append(hand.hold(counter=(counter + 1 + k) & 0xFF, echo=moment_echo))
        else:
            made += hand.act(POUR, counter=(counter + 1 + k) & 0xFF, echo=moment_echo)
    return made


def _released(hand: Hand, queue: list[Received], stuck_ms: int, heartbeats: bool, burst: int) -> tuple[int, int]:
    """(peak assist, commands accepted as ACT) when the queue is let out after `stuck_ms`, `burst` frames a tick."""
    peak = accepted = 0
    for k in range(stuck_ms):
        hand.tick(*((hand.heartbeat(),) if heartbeats and k % 100 == 0 else ()))
        peak = max(peak, abs(hand.outputs.assist_unm)) if k > 150 else 0
    for start in range(0, len(queue), burst):
        fed_ms = hand.state.command_ms
        hand.tick(*queue[start : start + burst], *((hand.heartbeat(),) if heartbeats and start % 64 == 0 else ()))
        peak = max(peak, abs(hand.outputs.assist_unm))
        accepted += hand.state.command_ms > fed_ms and not hand.state.command_is_hold
    for _ in range(500):
        hand.tick()
        peak = max(peak, abs(hand.outputs.assist_unm))
    return peak, accepted


def stale_queue(ages: int) -> Row:
    """512 stale frames of a dead bridge at many ages; with heartbeats that were not stuck; with HOLDs among the ACTs."""
    rng, peak, accepted, cases = random.Random(1), 0, 0, 0
    stuck = [101, 140, 5_120, 5_140, 10_240] + [rng.randint(101, 21_000) for _ in range(ages)]
    for stuck_ms, heartbeats, holds in product(stuck, (False, True), (False, True)):
        hand = Hand().to_assist() if rng.random() < 0.5 else Hand().to_ready()
        queue = _made_while_stuck(hand, 40, holds)
        found = _released(hand, queue, stuck_ms, heartbeats, rng.choice((1, 4, QUEUE)))
        peak, accepted, cases = max(peak, found[0]), accepted + found[1], cases + 1
    return Row(
        "replay",
        f"{QUEUE} stale frames left in a queue by a dead bridge: zero assist",
        f"{cases} queues, {accepted} accepted, peak assist {peak} uN m",
        peak == 0 and accepted == 0,
    )


def _recorded(seed: int, milliseconds: int) -> list[Received]:
    """Everything a bridge sent in a session with plenty of ACT."""
    rig = Rig(seed)
    rig.until("READY")
    for k in range(milliseconds):
        if k % 1500 == 0:
            rig.decision = (ACT_TAKE, HOLD, ACT_POUR, HOLD)[k // 1500 % 4]
        rig.tick()
    return rig.sent


def earlier_session(seeds: int) -> Row:
    """Recorded traffic of an earlier session into the next one, at its own pace and all at once."""
    peak, frames_in = 0, 0
    for seed in range(seeds):
        traffic = _recorded(seed, 6000)
        rig = Rig(seed + 1000)
        rig.until("READY")
        rig.bridge_runs = False
        for k, frame in enumerate(traffic):
            rig.put(frame)
            frames_in += 1
            if seed % 2 or k % 2:
                rig.tick()
                peak = max(peak, abs(rig.outputs.assist_unm))
    return Row(
        "replay",
        "recorded traffic of an earlier session: zero assist",
        f"{frames_in} frames, peak assist {peak} uN m",
        peak == 0,
    )


def _poised(state: ControllerState, act: Received, auth: Received) -> ControllerState:
    """The device as a perfect adversary wants it: READY, armed, both E2E counters just before the replayed frames."""
    poised = copied(state)
    for frame in (act, auth):
        slot = frames.RECEIVED_IDS.index(frame.can_id)
        ready = e2e.Receiver((frame.data[2] - 1) & 0xFF, e2e.Machine.VALID, (e2e.Check.OK,) * 4)
        poised.receivers = (*poised.receivers[:slot], ready, *poised.receivers[slot + 1 :])
    poised.mac_failures = 0
    return poised


def million(count: int, seed: int) -> Row:
    """Replays past E2E and session number: of this session, and of earlier ones that had the same number."""
    rng = random.Random(seed)
    rig = Rig(seed)
    rig.until("READY")
    rig.decision = ACT_TAKE
    rig.run(9000)
    state = copied(rig.state)
    state.state = State.READY
    pools = [[f for f in rig.sent if f.can_id in COMMANDS]]
    pools += [[f for f in _recorded(seed + k, 9000) if f.can_id in COMMANDS] for k in (1, 2)]  # same number, other key
    pairs = [(a, b) for pool in pools for a, b in pairwise(pool) if (a.can_id, b.can_id) == COMMANDS]
    accepted = fed = past_echo = 0
    for _ in range(count):
        act, auth = pairs[rng.randrange(len(pairs))]
        poised = _poised(state, act, auth)
        if rng.random() < 0.7:  # the adversary waits until the replayed echo is fresh once more
            echo = (int.from_bytes(act.data, "little") >> 46) & 0xFF
            poised.echoes = (*poised.echoes[-4:], (echo, rig.now_ms - 3))
        before = poised.command_ms
        receive(poised, act, 0, rig.now_ms + 1)
        past_echo += poised.pending is not None
        receive(poised, auth, 0, rig.now_ms + 1)
        fed += poised.command_ms != before
        accepted += poised.state != State.READY
    return Row(
        "replay",
        "replays past E2E and session number: accepted",
        f"{count} replays ({past_echo} past the echo too), {accepted + fed} accepted",
        accepted == 0 and fed == 0 and past_echo > count // 3,
    )


def run(scale: Scale) -> list[Row]:
    """All of it."""
    return [
        doubled(),
        stale_queue(scale.of(40, 0)),
        earlier_session(scale.of(20, 2)),
        million(scale.of(1_000_000, 10_000), scale.seed),
    ]
