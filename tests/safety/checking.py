"""Model checking: all states of tests/safety/tools/model.py, every transition on the real code, invariants per tick."""

from __future__ import annotations

import random
from collections import deque
from copy import copy

from firmware_sim import e2e, frames, watchdogs
from firmware_sim.c import binding
from firmware_sim.controllers import power_on
from firmware_sim.law.damping import LEASH_UNM_MS
from firmware_sim.memory import ControllerState, Received
from firmware_sim.states import State
from tests.safety.hand import BOOT_NONCE, KEY, Hand
from tests.safety.table import Row, Scale
from tests.safety.tools.model import CUT, INPUTS, OPERATE, QUANTUM_MS, Model, step

_LETTER = {
    e2e.Check.OK: "G",
    e2e.Check.OK_SOME_LOST: "G",
    e2e.Check.ERROR: "E",
    e2e.Check.REPEATED: "O",
    e2e.Check.NO_NEW_DATA: "O",
    e2e.Check.WRONG_SEQUENCE: "O",
}
_RAMPING = (State.ASSIST, State.RAMP_DOWN, State.LATCHED, State.ESTOP)


class Broken(AssertionError):
    """An invariant that the real code does not keep."""


def clone(hand: Hand) -> Hand:
    """The same moment, to go on from in another way."""
    twin = copy(hand)
    twin.counters, twin.log = dict(hand.counters), []
    return twin


def abstract(hand: Hand) -> Model:
    """What the model says of the real state."""
    s = hand.state
    receiver = s.receivers[frames.RECEIVED_IDS.index(frames.ACT_CMD)]
    return Model(
        s.state.name,
        s.ramp_fault if s.state == State.RAMP_DOWN else False,
        s.armed,
        s.neutral,
        receiver.machine.name,
        "".join(_LETTER[check] for check in receiver.window),
        (hand.now_ms - s.command_ms) // QUANTUM_MS if s.command_live else None,
        (hand.now_ms - s.heartbeat_ms) // QUANTUM_MS if s.armed else 0,
        len(s.trips),
        s.mac_failures,
        s.verb if s.state == State.ASSIST else 0,
    )


def frames_of(hand: Hand, arrival: str) -> tuple[list[Received], bool]:
    """The frames of one arrival, right in everything but what its name says; and whether a hand is on the device."""
    slot = hand.state.receivers[frames.RECEIVED_IDS.index(frames.ACT_CMD)]
    hand.counters[frames.ACT_CMD] = 0 if slot.counter is None else slot.counter
    if arrival == "heartbeat":
        return [hand.heartbeat()], False
    if arrival == "hold":
        return [hand.hold()], False
    if arrival in ("act", "act_other"):
        return list(hand.act(CUT if arrival == "act_other" else OPERATE)), False
    if arrival == "act_unauthorised":
        return [hand.act_cmd(frames.GATE_ACT, OPERATE)], False
    if arrival == "act_stale_echo":
        command = hand.act_cmd(frames.GATE_ACT, OPERATE, echo=(hand.status_counter - 100) & 0xFF)
        return [command, hand.auth(command)], False
    if arrival == "act_forged":
        command = hand.act_cmd(frames.GATE_ACT, OPERATE)
        return [command, hand.auth(command, key=b"not the true key")], False
    if arrival == "act_disturbed":
        command = hand.act_cmd(frames.GATE_ACT, OPERATE)
        return [command, hand.act_cmd(frames.GATE_ACT, CUT), hand.auth(command)], False
    if arrival == "corrupt":
        return [Received(frames.ACT_CMD, b"\xff" * 8)], False
    if arrival == "duplicate":
        return ([] if slot.counter is None else [hand.hold(counter=slot.counter)]), False
    if arrival == "stop":
        return [Received(frames.STOP, b"")], False
    if arrival == "own_id":
        return [Received(frames.CTRL_STATUS, b"")], False
    if arrival in ("arm", "clear"):
        purpose = frames.PURPOSE_ARM if arrival == "arm" else frames.PURPOSE_CLEAR_LATCH
        number = hand.state.last_session % 255 + 1
        sent = [hand.request(purpose), hand.response(purpose, session=number)]
        return (sent, False) if arrival == "arm" else ([*sent, hand.hold()], True)
    return [], False


def _machine(state: ControllerState) -> int:
    """Of the E2E receiver of ACT_CMD, without taking the whole state of C apart."""
    slot = frames.RECEIVED_IDS.index(frames.ACT_CMD)
    return state.receivers[slot].machine if isinstance(state, ControllerState) else state.machine(slot)


def shaking(now_ms: int) -> int:
    """Velocity of the model's world: a slow movement upon which there is a tremor of 6 Hz, so that every verb damps."""
    phase = now_ms % 168
    return 20_000 + 190 * (phase - 42 if phase < 84 else 126 - phase)


def invariants(hand: Hand, before: State, assist_before: int, arrival: str) -> None:
    """What holds after every single tick of the real code. Raises Broken."""
    s, assist = hand.state, hand.outputs.assist_unm
    age_ms = hand.now_ms - s.command_ms
    latched = (State.LATCHED, State.ESTOP)
    rules = {
        "assist only while assisting or ramping": assist == 0 or s.state in _RAMPING,
        "assist rises only in ASSIST": abs(assist) <= abs(assist_before) or s.state == State.ASSIST,
        "ASSIST only with a live authorised command": s.state != State.ASSIST
        or (s.armed and s.command_live and not s.command_is_hold and age_ms < watchdogs.COMMAND_LIMIT_MS),
        "ASSIST only under a valid E2E machine": s.state != State.ASSIST or _machine(s) == e2e.Machine.VALID,
        "ASSIST only out of READY": s.state != State.ASSIST or before in (State.READY, State.ASSIST),
        "READY only out of FOLLOW, a clean ramp or an assist of zero": s.state != State.READY
        or before in (State.FOLLOW, State.READY, State.RAMP_DOWN)
        or (before == State.ASSIST and assist_before == 0),
        "a latch is left only by clearing": before not in latched or s.state in latched or arrival == "clear",
        "an emergency stop is no mere latch": before != State.ESTOP or s.state != State.LATCHED,
        "no session while latched": s.state not in latched or not s.armed,
        "no key without a session": s.armed == bool(s.key) == bool(s.session),
        "silence ends assist within 150 ms": assist == 0 or age_ms < 150,
        "torque parts stay within their caps": abs(assist) <= 1_000_000 and hand.outputs.gravity_unm == 0,
        "damping only removes energy": assist * shaking(hand.now_ms) <= 0 and assist == s.torque.damping_unm,
        "the leash holds": abs(s.torque.impulse) <= LEASH_UNM_MS,
        "nothing pushes, so no work is spent": s.torque.work == 0,
    }
    for rule, kept in rules.items():
        if not kept:
            raise Broken(f"{rule}: {s.state.name} ({s.reason.name}) after {arrival}, assist {assist}")


INVARIANTS = 15


def quantum(hand: Hand, arrival: str) -> bool:
    """One quantum of the real code, invariants after every tick. True where an assist ended that was at zero by itself."""
    received, local_clear = frames_of(hand, arrival)
    at_zero = False
    for k in range(QUANTUM_MS):
        before, assist = hand.state.state, hand.outputs.assist_unm
        hand.tick(
            *(received if k == 0 else ()),
            local_clear=local_clear and k == 0,
            velocity_mdeg_s=shaking(hand.now_ms + 1),
        )
        if k == 0 and arrival == "arm" and hand.state.armed and hand.state.session != hand.session:
            hand.session, hand.key, hand.freshness = hand.state.session, hand.session_key, 0
        invariants(hand, before, assist, arrival)
        at_zero |= before == State.ASSIST != hand.state.state and assist == 0
    return at_zero


def explore(limit: int | None, seed: int, controller: str = "python") -> tuple[dict[Model, Hand], int, list[str]]:
    """(a real moment for every model state found, transitions replayed, mismatches); breadth first, `limit` for a sample."""
    start = Hand(power_on(controller, KEY, BOOT_NONCE)).to_follow()
    first = abstract(start)
    found, queue, replayed, wrong = {first: start}, deque([first]), 0, []
    rng = random.Random(seed)
    if limit is not None:  # a sample begins where an assist is in reach
        hand = start
        for arrival in ("arm", "hold", "hold", "hold", "hold", "act", "act", "act_other"):
            hand = clone(hand)
            quantum(hand, arrival)
            found[abstract(hand)] = hand
            queue.append(abstract(hand))
    while queue:
        if limit is not None and replayed >= limit:
            break
        if limit is not None:  # a sample goes deep as well as wide
            queue.rotate(-rng.randrange(len(queue)))
        model = queue.popleft()
        for arrival in INPUTS:
            hand, at_zero = clone(found[model]), False
            try:
                at_zero = quantum(hand, arrival)
            except Broken as broken:
                wrong.append(str(broken))
            expected = step(model, arrival, at_zero)
            replayed += 1
            got = abstract(hand)
            if got != expected:
                wrong.append(f"{model} on {arrival}: model {expected}, code {got}")
            elif got not in found:
                found[got] = hand
                queue.append(got)
    return found, replayed, wrong


def bounded(moments: list[Hand], phases: range) -> tuple[int, int, int, int]:
    """Worst (silence, HOLD, STOP) to zero assist in ms over all moments of assist and phases; and how many were tried."""
    worst_silence = worst_hold = worst_stop = tried = 0
    for moment in moments:
        fed_ms = moment.state.command_ms
        running = clone(moment)
        for phase in range(QUANTUM_MS):
            if phase:
                running.tick()
            if running.state.state != State.ASSIST:
                break
            if phase not in phases:
                continue
            tried += 1
            silent, stopped, holding = clone(running), clone(running), clone(running)
            silent.until_zero()
            worst_silence = max(worst_silence, silent.now_ms - fed_ms)
            for hand, (received, _) in (
                (stopped, frames_of(stopped, "stop")),
                (holding, frames_of(holding, "hold")),
            ):
                hand.tick(*received)
                elapsed = 1 + hand.until_zero()
                if hand is stopped:
                    worst_stop = max(worst_stop, elapsed)
                else:
                    worst_hold = max(worst_hold, elapsed)
    return worst_silence, worst_hold, worst_stop, tried


def in_c(scale: Scale) -> list[Row]:
    """The same search over the C controller: every transition of the model, every invariant."""
    claim = "every transition of the model, and every invariant, on the C controller"
    if (why := binding.why_not()) is not None:
        return [Row("model_c", claim, f"the C controller is {why}", False)]
    found, replayed, wrong = explore(1000 if scale.quick else None, scale.seed, "c")
    figure = f"{len(found)} states, {replayed} transitions, {replayed * QUANTUM_MS} ticks, {len(wrong)} differ"
    return [Row("model_c", claim, figure + (f": {wrong[0]}" if wrong else ""), not wrong)]


def run(scale: Scale) -> list[Row]:
    """All of it; the full run is exhaustive, the quick one a seeded walk."""
    found, replayed, wrong = explore(3000 if scale.quick else None, scale.seed)
    assisting = [hand for model, hand in found.items() if model.mode == "ASSIST"]
    rng = random.Random(scale.seed)
    sampled = rng.sample(assisting, min(len(assisting), 3 if scale.quick else 60))
    silence, hold, stop, tried = bounded(sampled, range(0, QUANTUM_MS, 7 if scale.quick else 1))
    ticks = replayed * QUANTUM_MS
    what = "sampled" if scale.quick else "all reachable"
    return [
        Row(
            "model",
            f"{what} states; every transition of them replayed on the code",
            f"{len(found)} states, {replayed} transitions, {len(wrong)} differ" + (f": {wrong[0]}" if wrong else ""),
            not wrong and len(assisting) > 0,
        ),
        Row("model", f"{INVARIANTS} invariants after every tick", f"{ticks} ticks, {len(wrong)} broken", not wrong),
        *(
            Row(
                "model",
                f"{what} -> zero assist <= {limit} ms at every phase",
                f"worst {worst} ms in {tried} moments",
                0 < worst <= limit,
            )
            for what, worst, limit in (("silence", silence, 150), ("HOLD", hold, 60), ("STOP", stop, 20))
        ),
    ]
