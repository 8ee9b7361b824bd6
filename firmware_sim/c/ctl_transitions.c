/* How events change the controller: the table, and what has to happen on the way into a state (transitions.py). */
#include <string.h>

#include "ctl_parts.h"

bool ctl_fresh(int64_t stamp_ms, int64_t now_ms, int64_t limit_ms) {
    return stamp_ms <= now_ms && now_ms - stamp_ms <= limit_ms;
}

void ctl_fire(ctl_state *state, uint8_t event, uint8_t reason, int64_t now_ms) {
    uint8_t before = state->state;
    uint8_t target = ctl_transitions[before][event];
    if (before == CTL_STATE_RAMP_DOWN && event == CTL_EVENT_FAULT) {
        state->ramp_fault = true; /* on its way to READY; now it is not */
        state->reason = reason;
    }
    if (target == before) {
        return;
    }
    state->state = target;
    state->reason = reason;
    switch (target) {
    case CTL_STATE_SELFTEST:
        state->self_test_ms = now_ms;
        break;
    case CTL_STATE_FOLLOW:
        state->neutral = 0;
        break;
    case CTL_STATE_ASSIST:
        state->assist_since_ms = now_ms;
        break;
    case CTL_STATE_RAMP_DOWN:
        state->ramp_fault = event == CTL_EVENT_FAULT;
        break;
    case CTL_STATE_LATCHED:
    case CTL_STATE_ESTOP:
        ctl_disarm(state);
        ctl_emergency(state, reason);
        break;
    default: /* READY, PASSIVE */
        break;
    }
}

void ctl_disarm(ctl_state *state) {
    state->armed = false;
    state->session = 0;
    memset(state->key, 0, sizeof state->key);
    state->freshness = 0;
    state->pending = (ctl_pending){0};
    state->neutral = 0;
}

/* The last `limit` times, this one included: oldest out. */
static void remember(int64_t *times_ms, uint8_t *count, uint8_t limit, int64_t now_ms) {
    if (*count == limit) {
        memmove(times_ms, times_ms + 1, (limit - 1U) * sizeof *times_ms);
        (*count)--;
    }
    times_ms[*count] = now_ms;
    (*count)++;
}

/* At least `limit` of the remembered times lie within the last `window_ms`. */
static bool crowded(const int64_t *times_ms, uint8_t count, uint8_t limit, int64_t now_ms, int64_t window_ms) {
    int recent = 0;
    for (uint8_t at = 0; at < count; at++) {
        recent += now_ms - times_ms[at] < window_ms;
    }
    return recent >= limit;
}

void ctl_trip(ctl_state *state, uint8_t reason, int64_t now_ms) {
    bool matters = state->state == CTL_STATE_READY || state->state == CTL_STATE_ASSIST ||
                   (state->state == CTL_STATE_RAMP_DOWN && !state->ramp_fault);
    ctl_fire(state, CTL_EVENT_FAULT, reason, now_ms);
    if (!matters) {
        return;
    }
    ctl_count(state, CTL_COUNT_TRIPS, 1);
    ctl_emergency(state, reason);
    remember(state->trips, &state->trip_count, CTL_TRIP_LIMIT, now_ms);
    if (crowded(state->trips, state->trip_count, CTL_TRIP_LIMIT, now_ms, CTL_TRIP_WINDOW_MS)) {
        ctl_fire(state, CTL_EVENT_LATCH, CTL_REASON_REPEATED_TRIPS, now_ms);
    }
}

void ctl_mac_failed(ctl_state *state, int64_t now_ms) {
    state->mac_failures++;
    ctl_count(state, CTL_COUNT_MAC_FAILURES, 1);
    if (state->mac_failures >= CTL_MAC_FAILURE_LIMIT) {
        ctl_fire(state, CTL_EVENT_LATCH, CTL_REASON_MAC_FAILURES, now_ms);
    }
}

void ctl_bus_off(ctl_state *state, int64_t now_ms) {
    remember(state->bus_offs, &state->bus_off_count, CTL_BUS_OFF_LIMIT, now_ms);
    ctl_disarm(state);
    ctl_fire(state, CTL_EVENT_FAULT, CTL_REASON_BUS_OFF, now_ms);
    if (crowded(state->bus_offs, state->bus_off_count, CTL_BUS_OFF_LIMIT, now_ms, CTL_BUS_OFF_WINDOW_MS)) {
        ctl_fire(state, CTL_EVENT_LATCH, CTL_REASON_REPEATED_BUS_OFF, now_ms);
    }
}

/* Silence: the E2E machine has to earn trust again, and the session ends (docs/decisions/104). */
void ctl_command_overdue(ctl_state *state, int64_t now_ms) {
    state->command_live = false;
    ctl_disarm(state);
    ctl_e2e_overdue(&state->receivers[CTL_SLOT_ACT_CMD]);
    ctl_trip(state, CTL_REASON_COMMAND_TIMEOUT, now_ms);
}
