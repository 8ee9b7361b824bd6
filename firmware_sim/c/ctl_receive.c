/* From frames to events: what the controller believes of what the bus brings (receive.py).
 *
 * HOLD and STOP need one plain frame. ACT needs a VALID E2E machine, an armed session, a fresh echo, a young sensing, a
 * verb that is assisted, and the right MAC within 10 ms. An ACT that fails any of it counts as HOLD and feeds no deadline.
 */
#include <string.h>

#include "ctl_parts.h"

static bool is_own(uint32_t can_id) {
    for (size_t slot = 0; slot < CTL_OWN_COUNT; slot++) {
        if (can_id == ctl_own[slot].can_id) {
            return true;
        }
    }
    return false;
}

static uint32_t slot_of(uint32_t can_id) {
    uint32_t slot = 0;
    while (slot < CTL_RECEIVED_COUNT && can_id != ctl_received[slot].can_id) {
        slot++;
    }
    return slot;
}

static void remember_command(ctl_state *state, const uint8_t *data, int64_t now_ms) {
    if (state->command_count == CTL_COMMAND_SLOTS) {
        memmove(state->commands, state->commands + 1, sizeof state->commands - sizeof state->commands[0]);
        state->command_count--;
    }
    ctl_command *command = &state->commands[state->command_count++];
    command->arrived_ms = now_ms;
    command->waited = false;
    memcpy(command->data, data, CTL_FRAME_LENGTH);
}

/* E2E check and state machine; only a frame that is new and in sequence goes on. */
static bool checked(ctl_state *state, uint32_t slot, const uint8_t *data, int64_t now_ms) {
    ctl_receiver *receiver = &state->receivers[slot];
    uint8_t before = receiver->machine;
    uint64_t lost = receiver->lost;
    uint8_t result = ctl_e2e_check(slot, data, receiver);
    ctl_count(state, CTL_COUNT_LOST, receiver->lost - lost);
    if (result == CTL_CHECK_ERROR) {
        ctl_reject(state, CTL_REJECT_CRC);
    } else if (slot == CTL_SLOT_ACT_CMD) {
        remember_command(state, data, now_ms);
    } else if (slot == CTL_SLOT_ARM_REQUEST) {
        ctl_asked(state, data);
    }
    if (result == CTL_CHECK_REPEATED) {
        ctl_reject(state, CTL_REJECT_REPEATED);
    } else if (result == CTL_CHECK_WRONG_SEQUENCE) {
        ctl_reject(state, CTL_REJECT_SEQUENCE);
    }
    if (slot == CTL_SLOT_ACT_CMD && before == CTL_MACHINE_VALID && receiver->machine == CTL_MACHINE_INVALID) {
        state->neutral = 0;
        ctl_trip(state, CTL_REASON_E2E_INVALID, now_ms);
    }
    return result == CTL_CHECK_OK || result == CTL_CHECK_OK_SOME_LOST;
}

/* Age of the youngest CTRL_STATUS that carried this counter; -1 when it is not among the last ones. */
static int64_t echo_age_ms(const ctl_state *state, uint32_t echo, int64_t now_ms) {
    for (size_t at = state->echo_count; at > 0; at--) {
        if (state->echoes[at - 1].counter == echo) {
            return now_ms - state->echoes[at - 1].sent_ms;
        }
    }
    return -1;
}

static bool echo_fresh(int64_t age_ms) { return age_ms >= 0 && age_ms <= CTL_ECHO_LIMIT_MS; }

static bool sensing_stale(uint32_t age) { return age * 2 > CTL_SENSING_LIMIT_MS; }

static bool valid(const ctl_state *state) {
    return state->receivers[CTL_SLOT_ACT_CMD].machine == CTL_MACHINE_VALID;
}

/* A fully accepted command: the only thing that feeds the command watchdog. */
static void accept(ctl_state *state, uint8_t counter, bool is_hold, int64_t arrived_ms) {
    state->command_live = true;
    state->command_ms = arrived_ms;
    state->command_is_hold = is_hold;
    state->accepted_counter = counter;
}

/* Fields of ACT_CMD in their order. */
enum { GATE, VERB, CONFIDENCE, SESSION, ECHO, AGE };

/* First plain condition of ACT that fails; ACCEPTED when all hold and only the MAC is missing. */
static uint8_t why_not(ctl_state *state, const uint32_t *values, int64_t now_ms) {
    if (!valid(state)) {
        return CTL_REJECT_E2E_STATE;
    }
    if (!state->armed) {
        return CTL_REJECT_NOT_ARMED;
    }
    if (values[SESSION] != state->session) {
        return CTL_REJECT_SESSION;
    }
    int64_t age_ms = echo_age_ms(state, values[ECHO], now_ms);
    if (!echo_fresh(age_ms)) {
        return CTL_REJECT_ECHO;
    }
    if (age_ms > state->counters[CTL_ECHO_AGE_MAX_MS]) {
        state->counters[CTL_ECHO_AGE_MAX_MS] = (uint32_t)age_ms;
    }
    if (sensing_stale(values[AGE])) {
        return CTL_REJECT_AGE;
    }
    if (ctl_profiles[values[VERB]].cap_unm == 0) {
        return CTL_REJECT_VERB;
    }
    return CTL_REJECT_ACCEPTED;
}

static uint8_t hold_reason(uint8_t why) {
    switch (why) {
    case CTL_REJECT_E2E_STATE:
        return CTL_REASON_E2E_INVALID;
    case CTL_REJECT_ECHO:
        return CTL_REASON_ECHO_STALE;
    case CTL_REJECT_AGE:
        return CTL_REASON_SENSING_STALE;
    case CTL_REJECT_VERB:
        return CTL_REASON_VERB_UNASSISTED;
    default: /* NOT_ARMED, SESSION */
        return CTL_REASON_NOT_ARMED;
    }
}

static void hold(ctl_state *state, const uint8_t *data, const uint32_t *values, int64_t now_ms) {
    ctl_reject(state, CTL_REJECT_ACCEPTED);
    accept(state, data[2], true, now_ms);
    bool stale = sensing_stale(values[AGE]);
    bool trusted = state->armed && values[SESSION] == state->session && valid(state);
    if (!trusted || stale || !echo_fresh(echo_age_ms(state, values[ECHO], now_ms))) {
        state->neutral = 0;
    } else if (state->neutral < CTL_NEUTRAL_HOLDS) {
        state->neutral++;
    }
    if (stale) { /* a dropout, not a change of mind: back to following, and neutral first (docs/decisions/001) */
        ctl_fire(state, CTL_EVENT_FAULT, CTL_REASON_SENSING_STALE, now_ms);
    } else {
        ctl_fire(state, CTL_EVENT_HOLD, CTL_REASON_HOLD, now_ms);
    }
    if (state->neutral >= CTL_NEUTRAL_HOLDS) {
        ctl_fire(state, CTL_EVENT_NEUTRAL, CTL_REASON_NEUTRAL, now_ms);
    }
}

static void act_cmd(ctl_state *state, const uint8_t *data, const uint32_t *values, int64_t now_ms) {
    if (state->pending.waits) {
        ctl_authorisation_missing(state, now_ms);
    }
    if (values[GATE] == CTL_GATE_HOLD) {
        hold(state, data, values, now_ms);
        return;
    }
    state->neutral = 0;
    uint8_t why = why_not(state, values, now_ms);
    if (why != CTL_REJECT_ACCEPTED) {
        ctl_reject(state, why);
        ctl_fire(state, CTL_EVENT_HOLD, hold_reason(why), now_ms);
        return;
    }
    state->pending.waits = true;
    state->pending.arrived_ms = now_ms;
    state->pending.verb = (uint8_t)values[VERB];
    state->pending.counter = data[2];
    memcpy(state->pending.data, data, CTL_FRAME_LENGTH);
    state->commands[state->command_count - 1].waited = true;
}

void ctl_authorisation_missing(ctl_state *state, int64_t now_ms) {
    state->pending = (ctl_pending){0};
    ctl_reject(state, CTL_REJECT_AUTH_MISSING);
    ctl_fire(state, CTL_EVENT_HOLD, CTL_REASON_AUTH_MISSING, now_ms);
}

/* The command that waits, if any, is not the one authorised: both count as HOLD, neither as a wrong MAC. */
static void disturbed_pair(ctl_state *state, const ctl_command *meant, int64_t now_ms) {
    ctl_reject(state, CTL_REJECT_AUTH_UNPAIRED);
    if (state->pending.waits) {
        ctl_authorisation_missing(state, now_ms);
    }
    if (meant != NULL && meant->waited) {
        accept(state, meant->data[2], true, meant->arrived_ms);
    }
}

static bool recent(const ctl_command *command, int64_t now_ms) {
    return ctl_fresh(command->arrived_ms, now_ms, CTL_AUTH_LIMIT_MS);
}

/* The youngest of the recent commands that this MAC authorises. */
static const ctl_command *meant_by(const ctl_state *state, uint32_t freshness, uint32_t mac, int64_t now_ms) {
    uint8_t first[16];
    ctl_first_subkey(state->key, first);
    for (size_t at = state->command_count; at > 0; at--) {
        const ctl_command *command = &state->commands[at - 1];
        if (recent(command, now_ms) && mac == ctl_act_mac(state, first, freshness, command->data)) {
            return command;
        }
    }
    return NULL;
}

static void authorised(ctl_state *state, int64_t now_ms) {
    ctl_pending pending = state->pending;
    state->pending = (ctl_pending){0};
    ctl_reject(state, CTL_REJECT_ACCEPTED);
    accept(state, pending.counter, false, pending.arrived_ms);
    if (state->state == CTL_STATE_READY) {
        state->verb = pending.verb;
    }
    if (pending.verb == state->verb) {
        ctl_fire(state, CTL_EVENT_ACT, CTL_REASON_AUTHORISED, now_ms);
    } else {
        ctl_fire(state, CTL_EVENT_VERB_CHANGE, CTL_REASON_VERB_CHANGE, now_ms);
    }
}

static void act_auth(ctl_state *state, const uint32_t *values, int64_t now_ms) {
    bool waits = state->pending.waits;
    if (waits && !ctl_fresh(state->pending.arrived_ms, now_ms, CTL_AUTH_LIMIT_MS)) {
        ctl_authorisation_missing(state, now_ms);
        return;
    }
    size_t young = 0;
    for (size_t at = 0; at < state->command_count; at++) {
        young += recent(&state->commands[at], now_ms);
    }
    /* There may have been more commands, or a tick's one MAC is spent: whose MAC this is cannot be known. */
    bool crowded = young == CTL_COMMAND_SLOTS || state->mac_checked;
    uint64_t freshness = ctl_whole_freshness((uint8_t)values[0], state->freshness);
    const ctl_command *meant = NULL;
    if (!crowded && young > 0 && state->armed && freshness <= UINT32_MAX) {
        state->mac_checked = true;
        meant = meant_by(state, (uint32_t)freshness, values[1], now_ms);
    }
    if (meant != NULL) {
        state->freshness = (uint32_t)freshness;
    }
    if (!waits || crowded || (meant != NULL && memcmp(meant->data, state->pending.data, CTL_FRAME_LENGTH) != 0)) {
        disturbed_pair(state, meant, now_ms);
    } else if (meant == NULL) {
        state->pending = (ctl_pending){0};
        ctl_reject(state, CTL_REJECT_MAC);
        ctl_fire(state, CTL_EVENT_HOLD, CTL_REASON_AUTH_MISSING, now_ms);
        ctl_mac_failed(state, now_ms);
    } else {
        authorised(state, now_ms);
    }
}

static void heartbeat(ctl_state *state, const uint32_t *values, int64_t now_ms) {
    if (values[4] != CTL_PROTOCOL_VERSION) {
        ctl_reject(state, CTL_REJECT_RANGE);
        return;
    }
    ctl_reject(state, CTL_REJECT_ACCEPTED);
    state->heartbeat_ms = now_ms;
}

static void take(ctl_state *state, uint32_t slot, const ctl_frame *frame, uint32_t random_u32, int64_t now_ms) {
    uint32_t values[CTL_MOST_FIELDS] = {0};
    uint8_t why = ctl_unpack(slot, frame->data, values);
    if (why != CTL_REJECT_ACCEPTED) {
        ctl_reject(state, why);
        return;
    }
    switch (slot) {
    case CTL_SLOT_ACT_CMD:
        act_cmd(state, frame->data, values, now_ms);
        break;
    case CTL_SLOT_ACT_AUTH:
        act_auth(state, values, now_ms);
        break;
    case CTL_SLOT_BRIDGE_HB:
        heartbeat(state, values, now_ms);
        break;
    case CTL_SLOT_ARM_REQUEST:
        ctl_arm_request(state, values, random_u32, now_ms);
        break;
    case CTL_SLOT_ARM_RESPONSE:
        ctl_arm_response(state, values, now_ms);
        break;
    default: /* BRIDGE_DIAG: for people, not for the controller */
        ctl_reject(state, CTL_REJECT_ACCEPTED);
        break;
    }
}

void ctl_receive(ctl_state *state, const ctl_frame *frame, uint32_t random_u32, int64_t now_ms) {
    if (frame->can_id == CTL_STOP) { /* in any form: remote, FD, extended, of any length */
        ctl_reject(state, CTL_REJECT_ACCEPTED);
        ctl_fire(state, CTL_EVENT_STOP, CTL_REASON_STOP_RECEIVED, now_ms);
        return;
    }
    if (!frame->plain) {
        ctl_reject(state, CTL_REJECT_KIND);
        return;
    }
    if (is_own(frame->can_id)) {
        ctl_count(state, CTL_COUNT_OWN_ID, 1);
        ctl_fire(state, CTL_EVENT_LATCH, CTL_REASON_OWN_ID_SEEN, now_ms);
        return;
    }
    uint32_t slot = slot_of(frame->can_id);
    if (slot == CTL_RECEIVED_COUNT) {
        ctl_reject(state, CTL_REJECT_UNKNOWN_ID);
        return;
    }
    if (frame->length != CTL_FRAME_LENGTH) {
        ctl_reject(state, CTL_REJECT_LENGTH);
        return;
    }
    if (checked(state, slot, frame->data, now_ms)) {
        take(state, slot, frame, random_u32, now_ms);
    }
}
