/* Arming, and clearing a latch: request, challenge, response (receive.py). */
#include <string.h>

#include "ctl_parts.h"

static bool fresh_challenge(const ctl_state *state, int64_t now_ms) {
    return state->challenge.open && ctl_fresh(state->challenge.sent_ms, now_ms, CTL_CHALLENGE_LIMIT_MS);
}

/* An ARM_REQUEST, also one that goes no further: of another nonce than the open challenge's it is somebody else's. */
void ctl_asked(ctl_state *state, const uint8_t data[CTL_FRAME_LENGTH]) {
    uint32_t values[CTL_MOST_FIELDS];
    uint8_t why = ctl_unpack(CTL_SLOT_ARM_REQUEST, data, values);
    if (state->challenge.open && why == CTL_REJECT_ACCEPTED && values[0] != state->challenge.bridge_nonce) {
        state->challenge.disturbed = true;
    }
}

/* Answer with a challenge. The request is not authenticated, so it changes nothing else. */
void ctl_arm_request(ctl_state *state, const uint32_t *values, uint32_t random_u32, int64_t now_ms) {
    bool free = state->state == CTL_STATE_FOLLOW || state->state == CTL_STATE_READY;
    bool stopped = state->state == CTL_STATE_LATCHED || state->state == CTL_STATE_ESTOP;
    bool allowed = values[1] == CTL_PURPOSE_ARM ? free : stopped;
    if (!allowed || now_ms < state->handshake_rest_ms) {
        ctl_reject(state, CTL_REJECT_HANDSHAKE);
        return;
    }
    ctl_reject(state, CTL_REJECT_ACCEPTED);
    bool disturbed = fresh_challenge(state, now_ms) && state->challenge.disturbed;
    state->last_session = (uint8_t)(state->last_session % 255 + 1);
    state->challenge = (ctl_challenge){
        .open = true,
        .disturbed = disturbed,
        .purpose = (uint8_t)values[1],
        .session = state->last_session,
        .bridge_nonce = values[0],
        .device_nonce = random_u32,
        .sent_ms = now_ms,
    };
    const int64_t sent[CTL_MOST_FIELDS] = {random_u32, state->last_session};
    (void)ctl_send(state, CTL_SLOT_ARM_CHALLENGE, sent);
}

/* Somebody answered with another key; or, where two asked, may have meant the other challenge. */
static void answered_wrongly(ctl_state *state, bool disturbed, int64_t now_ms) {
    if (disturbed) {
        state->refusal = CTL_REFUSAL_DISTURBED;
        ctl_reject(state, CTL_REJECT_HANDSHAKE);
        state->handshake_rest_ms = now_ms + CTL_DISTURBED_REST_MS;
        return;
    }
    state->refusal = CTL_REFUSAL_KEY;
    ctl_reject(state, CTL_REJECT_MAC);
    ctl_mac_failed(state, now_ms);
}

void ctl_arm_response(ctl_state *state, const uint32_t *values, int64_t now_ms) {
    ctl_challenge challenge = state->challenge;
    uint8_t key[CTL_KEY_LENGTH];
    if (!fresh_challenge(state, now_ms) || values[1] != challenge.session) {
        ctl_reject(state, CTL_REJECT_HANDSHAKE);
        state->refusal = challenge.disturbed ? CTL_REFUSAL_DISTURBED : CTL_REFUSAL_LATE;
        return;
    }
    if (state->mac_checked) { /* a tick has time for one; the challenge stands, and the bridge asks again */
        ctl_reject(state, CTL_REJECT_HANDSHAKE);
        state->refusal = CTL_REFUSAL_DISTURBED;
        return;
    }
    state->mac_checked = true;
    ctl_session_key(state, key);
    state->challenge = (ctl_challenge){0};
    if (values[0] != ctl_arm_mac(key, &challenge)) {
        answered_wrongly(state, challenge.disturbed, now_ms);
        return;
    }
    ctl_reject(state, CTL_REJECT_ACCEPTED);
    state->refusal = CTL_REFUSAL_NONE;
    if (challenge.purpose == CTL_PURPOSE_CLEAR_LATCH) {
        state->clear_until_ms = now_ms + CTL_CLEAR_LIMIT_MS;
        return;
    }
    if (state->state != CTL_STATE_FOLLOW && state->state != CTL_STATE_READY) {
        return; /* an assist that began meanwhile keeps its session */
    }
    state->armed = true;
    state->session = challenge.session;
    memcpy(state->key, key, CTL_KEY_LENGTH);
    state->freshness = 0;
    state->heartbeat_ms = now_ms;
    state->neutral = 0;
    state->pending = (ctl_pending){0};
    ctl_fire(state, CTL_EVENT_FAULT, CTL_REASON_DISARMED, now_ms);
}
