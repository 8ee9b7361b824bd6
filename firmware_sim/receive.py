"""From frames to events: what the controller believes of what the bus brings. Nothing here raises on any input.

HOLD and STOP need one plain frame. ACT needs a VALID E2E machine, an armed session, a fresh echo, a young sensing, a
verb that is assisted, and the right MAC within 10 ms. An ACT that fails any of it counts as HOLD and feeds no deadline.
"""

from __future__ import annotations

from firmware_sim import e2e, frames, secoc, watchdogs
from firmware_sim.frames import Reject
from firmware_sim.memory import (
    COMMAND_SLOTS,
    COUNT_LOST,
    COUNT_OWN_ID,
    ECHO_AGE_MAX_MS,
    Challenge,
    Command,
    ControllerState,
    PendingAct,
    Received,
    Refusal,
    count,
    reject,
)
from firmware_sim.states import Event, Reason, State
from firmware_sim.transitions import fire, mac_failed, trip
from firmware_sim.transmit import send

_HOLD_REASON = {
    Reject.E2E_STATE: Reason.E2E_INVALID,
    Reject.NOT_ARMED: Reason.NOT_ARMED,
    Reject.SESSION: Reason.NOT_ARMED,
    Reject.ECHO: Reason.ECHO_STALE,
    Reject.AGE: Reason.SENSING_STALE,
    Reject.VERB: Reason.VERB_UNASSISTED,
}


def receive(state: ControllerState, frame: Received, random_u32: int, now_ms: int) -> None:
    """Take one frame in."""
    if frame.can_id == frames.STOP:  # in any form: remote, FD, extended, of any length
        reject(state, Reject.ACCEPTED)
        fire(state, Event.STOP, Reason.STOP_RECEIVED, now_ms)
        return
    if not frame.plain:
        reject(state, Reject.KIND)
        return
    if frame.can_id in frames.OWN_IDS:
        count(state, COUNT_OWN_ID)
        fire(state, Event.LATCH, Reason.OWN_ID_SEEN, now_ms)
        return
    if frame.can_id not in frames.RECEIVED_IDS:
        reject(state, Reject.UNKNOWN_ID)
        return
    if len(frame.data) != frames.FRAME_LENGTH:
        reject(state, Reject.LENGTH)
        return
    if not _checked(state, frame, now_ms):
        return
    why, values = frames.unpack(frame.can_id, frame.data)
    if why != Reject.ACCEPTED:
        reject(state, why)
    elif frame.can_id == frames.ACT_CMD:
        _act_cmd(state, frame.data, values, now_ms)
    elif frame.can_id == frames.ACT_AUTH:
        _act_auth(state, values, now_ms)
    elif frame.can_id == frames.BRIDGE_HB:
        _heartbeat(state, values, now_ms)
    elif frame.can_id == frames.ARM_REQUEST:
        _arm_request(state, values, random_u32, now_ms)
    elif frame.can_id == frames.ARM_RESPONSE:
        _arm_response(state, values, now_ms)
    else:
        reject(state, Reject.ACCEPTED)  # BRIDGE_DIAG: for people, not for the controller


def _checked(state: ControllerState, frame: Received, now_ms: int) -> bool:
    """E2E check and state machine; only a frame that is new and in sequence goes on."""
    slot = frames.RECEIVED_IDS.index(frame.can_id)
    before = state.receivers[slot]
    result, after = e2e.check(frame.can_id, frame.data, before)
    state.receivers = (*state.receivers[:slot], after, *state.receivers[slot + 1 :])
    if after.lost > before.lost:
        count(state, COUNT_LOST, after.lost - before.lost)
    if result == e2e.ERROR:
        reject(state, Reject.CRC)
    elif frame.can_id == frames.ACT_CMD:
        state.commands = (*state.commands, Command(now_ms, frame.data))[-COMMAND_SLOTS:]
    elif frame.can_id == frames.ARM_REQUEST:
        _asked(state, frame.data)
    if result == e2e.REPEATED:
        reject(state, Reject.REPEATED)
    elif result == e2e.WRONG_SEQUENCE:
        reject(state, Reject.SEQUENCE)
    if frame.can_id == frames.ACT_CMD and before.machine is e2e.VALID and after.machine is e2e.INVALID:
        state.neutral = 0
        trip(state, Reason.E2E_INVALID, now_ms)
    return result in (e2e.OK, e2e.OK_SOME_LOST)


def _asked(state: ControllerState, data: bytes) -> None:
    """An ARM_REQUEST, also one that goes no further: of another nonce than the open challenge's it is somebody else's."""
    why, values = frames.unpack(frames.ARM_REQUEST, data)
    challenge = state.challenge
    if challenge is not None and why == Reject.ACCEPTED and values[0] != challenge.bridge_nonce:
        state.challenge = challenge._replace(disturbed=True)


def _echo_age_ms(state: ControllerState, echo: int, now_ms: int) -> int | None:
    """Age of the youngest CTRL_STATUS that carried this counter; None when it is not among the last ones."""
    for counter, sent_ms in reversed(state.echoes):
        if counter == echo:
            return now_ms - sent_ms
    return None


def _echo_fresh(state: ControllerState, echo: int, now_ms: int) -> bool:
    age_ms = _echo_age_ms(state, echo, now_ms)
    return age_ms is not None and age_ms <= watchdogs.ECHO_LIMIT_MS


def _machine(state: ControllerState) -> e2e.Machine:
    return state.receivers[frames.RECEIVED_IDS.index(frames.ACT_CMD)].machine


def _act_cmd(state: ControllerState, data: bytes, values: tuple[int, ...], now_ms: int) -> None:
    gate, verb, _confidence, session, echo, age = values
    if state.pending is not None:
        authorisation_missing(state, now_ms)
    trusted = state.armed and session == state.session and _machine(state) == e2e.VALID
    if gate == frames.GATE_HOLD:
        reject(state, Reject.ACCEPTED)
        _accept(state, data[2], True, now_ms)
        stale = _sensing_stale(age)
        neutral = trusted and not stale and _echo_fresh(state, echo, now_ms)
        state.neutral = min(state.neutral + 1, watchdogs.NEUTRAL_HOLDS) if neutral else 0
        if stale:  # a dropout, not a change of mind: back to following, and neutral first (docs/decisions/001)
            fire(state, Event.FAULT, Reason.SENSING_STALE, now_ms)
        else:
            fire(state, Event.HOLD, Reason.HOLD, now_ms)
        if state.neutral >= watchdogs.NEUTRAL_HOLDS:
            fire(state, Event.NEUTRAL, Reason.NEUTRAL, now_ms)
        return
    state.neutral = 0
    why = _why_not(state, verb, session, echo, age, now_ms)
    if why != Reject.ACCEPTED:
        reject(state, why)
        fire(state, Event.HOLD, _HOLD_REASON[why], now_ms)
        return
    state.pending = PendingAct(now_ms, data, verb, data[2])
    state.commands = (*state.commands[:-1], Command(now_ms, data, waited=True))


def _why_not(state: ControllerState, verb: int, session: int, echo: int, age: int, now_ms: int) -> Reject:
    """First plain condition of ACT that fails; ACCEPTED when all hold and only the MAC is missing."""
    if _machine(state) != e2e.VALID:
        return Reject.E2E_STATE
    if not state.armed:
        return Reject.NOT_ARMED
    if session != state.session:
        return Reject.SESSION
    echo_age_ms = _echo_age_ms(state, echo, now_ms)
    if echo_age_ms is None or echo_age_ms > watchdogs.ECHO_LIMIT_MS:
        return Reject.ECHO
    if echo_age_ms > state.counters[ECHO_AGE_MAX_MS]:
        count(state, ECHO_AGE_MAX_MS, echo_age_ms - state.counters[ECHO_AGE_MAX_MS])
    if _sensing_stale(age):
        return Reject.AGE
    if state.profiles.of(verb).cap_unm == 0:
        return Reject.VERB
    return Reject.ACCEPTED


def _sensing_stale(age: int) -> bool:
    return age * 2 > watchdogs.SENSING_LIMIT_MS  # AGE_UNKNOWN is the largest of them


def _accept(state: ControllerState, counter: int, is_hold: bool, arrived_ms: int) -> None:
    """A fully accepted command: the only thing that feeds the command watchdog."""
    state.command_live = True
    state.command_ms = arrived_ms
    state.command_is_hold = is_hold
    state.accepted_counter = counter


def authorisation_missing(state: ControllerState, now_ms: int) -> None:
    """The waiting ACT got no ACT_AUTH in time, or the next command came first: it counts as HOLD."""
    state.pending = None
    reject(state, Reject.AUTH_MISSING)
    fire(state, Event.HOLD, Reason.AUTH_MISSING, now_ms)


def _act_auth(state: ControllerState, values: tuple[int, ...], now_ms: int) -> None:
    low_byte, mac = values
    pending = state.pending
    if pending is not None and not watchdogs.fresh(pending.arrived_ms, now_ms, watchdogs.AUTH_LIMIT_MS):
        authorisation_missing(state, now_ms)
        return
    recent = tuple(one for one in state.commands if watchdogs.fresh(one.arrived_ms, now_ms, watchdogs.AUTH_LIMIT_MS))
    # There may have been more commands, or a tick's one MAC is spent: whose MAC this is cannot be known.
    crowded = len(recent) == COMMAND_SLOTS or state.mac_checked
    freshness = secoc.whole_freshness(low_byte, state.freshness)
    known = () if crowded or not state.armed or freshness > secoc.FRESHNESS_LIMIT else recent
    state.mac_checked |= bool(known)
    meant = next((one for one in reversed(known) if mac == _act_mac(state, freshness, one.data)), None)
    if meant is not None:
        state.freshness = freshness
    if pending is None or crowded or (meant is not None and meant.data != pending.data):
        _disturbed_pair(state, meant, now_ms)
        return
    state.pending = None
    if meant is None:
        reject(state, Reject.MAC)
        fire(state, Event.HOLD, Reason.AUTH_MISSING, now_ms)
        mac_failed(state, now_ms)
        return
    reject(state, Reject.ACCEPTED)
    _accept(state, pending.counter, False, pending.arrived_ms)
    if state.state == State.READY:
        state.verb = pending.verb
    if pending.verb == state.verb:
        fire(state, Event.ACT, Reason.AUTHORISED, now_ms)
    else:
        fire(state, Event.VERB_CHANGE, Reason.VERB_CHANGE, now_ms)


def _act_mac(state: ControllerState, freshness: int, act_cmd: bytes) -> int:
    return secoc.act_mac(state.key, state.session, freshness, act_cmd)


def _disturbed_pair(state: ControllerState, meant: Command | None, now_ms: int) -> None:
    """The command that waits, if any, is not the one authorised: both count as HOLD, neither as a wrong MAC.

    Where the one authorised had passed every plain check, whoever has the key is alive: it feeds the deadline as a HOLD.
    """
    reject(state, Reject.AUTH_UNPAIRED)
    if state.pending is not None:
        authorisation_missing(state, now_ms)
    if meant is not None and meant.waited:
        _accept(state, meant.data[2], True, meant.arrived_ms)


def _heartbeat(state: ControllerState, values: tuple[int, ...], now_ms: int) -> None:
    if values[4] != frames.PROTOCOL_VERSION:
        reject(state, Reject.RANGE)
        return
    reject(state, Reject.ACCEPTED)
    state.heartbeat_ms = now_ms


def _arm_request(state: ControllerState, values: tuple[int, ...], random_u32: int, now_ms: int) -> None:
    """Answer with a challenge. The request is not authenticated, so it changes nothing else."""
    bridge_nonce, purpose = values
    if purpose == frames.PURPOSE_ARM:
        allowed = state.state in (State.FOLLOW, State.READY)
    else:
        allowed = state.state in (State.LATCHED, State.ESTOP)
    if not allowed or now_ms < state.handshake_rest_ms:
        reject(state, Reject.HANDSHAKE)
        return
    reject(state, Reject.ACCEPTED)
    before = state.challenge
    disturbed = (
        before is not None
        and before.disturbed
        and watchdogs.fresh(before.sent_ms, now_ms, watchdogs.CHALLENGE_LIMIT_MS)
    )
    state.last_session = state.last_session % 255 + 1
    state.challenge = Challenge(now_ms, purpose, state.last_session, bridge_nonce, random_u32, disturbed)
    send(state, frames.ARM_CHALLENGE, (random_u32, state.last_session))


def _arm_response(state: ControllerState, values: tuple[int, ...], now_ms: int) -> None:
    mac, session = values
    challenge = state.challenge
    if (
        challenge is None
        or session != challenge.session
        or not watchdogs.fresh(challenge.sent_ms, now_ms, watchdogs.CHALLENGE_LIMIT_MS)
    ):
        reject(state, Reject.HANDSHAKE)
        state.refusal = Refusal.DISTURBED if challenge is not None and challenge.disturbed else Refusal.LATE
        return
    if state.mac_checked:  # a tick has time for one; the challenge stands, and the bridge asks again
        reject(state, Reject.HANDSHAKE)
        state.refusal = Refusal.DISTURBED
        return
    state.mac_checked = True
    state.challenge = None
    key = secoc.session_key(state.shared_key, challenge.bridge_nonce, challenge.device_nonce, state.boot_nonce, session)
    expected = secoc.arm_mac(key, challenge.purpose, session, challenge.bridge_nonce, challenge.device_nonce)
    if mac != expected:
        if challenge.disturbed:  # who answered may have meant the other challenge, with the right key
            state.refusal = Refusal.DISTURBED
            reject(state, Reject.HANDSHAKE)
            state.handshake_rest_ms = now_ms + watchdogs.DISTURBED_REST_MS
            return
        state.refusal = Refusal.KEY
        reject(state, Reject.MAC)
        mac_failed(state, now_ms)
        return
    reject(state, Reject.ACCEPTED)
    state.refusal = Refusal.NONE
    if challenge.purpose == frames.PURPOSE_CLEAR_LATCH:
        state.clear_until_ms = now_ms + watchdogs.CLEAR_LIMIT_MS
        return
    if state.state not in (State.FOLLOW, State.READY):
        return  # an assist that began meanwhile keeps its session
    state.armed = True
    state.session = session
    state.key = key
    state.freshness = 0
    state.heartbeat_ms = now_ms
    state.neutral = 0
    state.pending = None
    fire(state, Event.FAULT, Reason.DISARMED, now_ms)
