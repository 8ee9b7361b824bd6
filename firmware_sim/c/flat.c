#include "flat.h"

#include <string.h>

/* One walk for both ways: `swap` moves a number to or from the list. */
typedef struct {
    int64_t *at;
    bool loads;
} walk;

#define SWAP(way, place)                                                 \
    do {                                                                 \
        if ((way)->loads) {                                              \
            (place) = (__typeof__(place))*(way)->at;                     \
        } else {                                                         \
            *(way)->at = (int64_t)(place);                               \
        }                                                                \
        (way)->at++;                                                     \
    } while (0)

static void swap_bytes(walk *way, uint8_t *bytes, size_t count) {
    for (size_t at = 0; at < count; at += 8) {
        memcpy(way->loads ? (void *)(bytes + at) : (void *)way->at, way->loads ? (void *)way->at : (void *)(bytes + at), 8);
        way->at++;
    }
}

static void swap_receivers(walk *way, ctl_state *s) {
    for (size_t slot = 0; slot < CTL_RECEIVED_COUNT; slot++) {
        ctl_receiver *one = &s->receivers[slot];
        SWAP(way, one->seen);
        SWAP(way, one->counter);
        SWAP(way, one->machine);
        SWAP(way, one->filled);
        for (size_t at = 0; at < CTL_WINDOW; at++) {
            if (!way->loads && at >= one->filled) {
                one->window[at] = 0;
            }
            SWAP(way, one->window[at]);
        }
        SWAP(way, one->lost);
    }
}

static void swap_commands(walk *way, ctl_state *s) {
    SWAP(way, s->pending.waits);
    SWAP(way, s->pending.arrived_ms);
    swap_bytes(way, s->pending.data, CTL_FRAME_LENGTH);
    SWAP(way, s->pending.verb);
    SWAP(way, s->pending.counter);
    SWAP(way, s->command_count);
    for (size_t at = 0; at < CTL_COMMAND_SLOTS; at++) {
        SWAP(way, s->commands[at].arrived_ms);
        swap_bytes(way, s->commands[at].data, CTL_FRAME_LENGTH);
        SWAP(way, s->commands[at].waited);
    }
    SWAP(way, s->echo_count);
    for (size_t at = 0; at < CTL_ECHO_SLOTS; at++) {
        SWAP(way, s->echoes[at].counter);
        SWAP(way, s->echoes[at].sent_ms);
    }
}

static void swap_session(walk *way, ctl_state *s) {
    swap_bytes(way, s->shared_key, CTL_KEY_LENGTH);
    swap_bytes(way, s->key, CTL_KEY_LENGTH);
    SWAP(way, s->challenge.open);
    SWAP(way, s->challenge.sent_ms);
    SWAP(way, s->challenge.purpose);
    SWAP(way, s->challenge.session);
    SWAP(way, s->challenge.bridge_nonce);
    SWAP(way, s->challenge.device_nonce);
    SWAP(way, s->challenge.disturbed);
}

static void swap_faults(walk *way, ctl_state *s) {
    SWAP(way, s->limits.angle_low_mdeg);
    SWAP(way, s->limits.angle_high_mdeg);
    SWAP(way, s->limits.speed_limit_mdeg_s);
    SWAP(way, s->limits.tracking_limit_unm);
    SWAP(way, s->trip_count);
    for (size_t at = 0; at < CTL_TRIP_LIMIT; at++) {
        if (!way->loads && at >= s->trip_count) {
            s->trips[at] = 0;
        }
        SWAP(way, s->trips[at]);
    }
    SWAP(way, s->bus_off_count);
    for (size_t at = 0; at < CTL_BUS_OFF_LIMIT; at++) {
        if (!way->loads && at >= s->bus_off_count) {
            s->bus_offs[at] = 0;
        }
        SWAP(way, s->bus_offs[at]);
    }
}

static void swap_outbox(walk *way, ctl_state *s) {
    SWAP(way, s->outbox_count);
    for (size_t at = 0; at < s->outbox_count; at++) {
        SWAP(way, s->outbox[at].can_id);
        swap_bytes(way, s->outbox[at].data, CTL_FRAME_LENGTH);
    }
}

static size_t swap_all(walk *way, ctl_state *s) {
    const int64_t *start = way->at;
#define X(name) SWAP(way, s->name);
    FLAT_PLAIN(X)
#undef X
    SWAP(way, s->moved_before);
    SWAP(way, s->previous_mdeg);
#define X(name) SWAP(way, s->torque.name);
    FLAT_LAW(X)
#undef X
    for (size_t at = 0; at < CTL_WINDOW_SLOTS; at++) {
        SWAP(way, s->torque.peaks[at]);
    }
    for (size_t at = 0; at < CTL_COUNTERS; at++) {
        SWAP(way, s->counters[at]);
    }
    for (size_t at = 0; at < CTL_OWN_COUNT; at++) {
        SWAP(way, s->tx_counters[at]);
    }
    swap_receivers(way, s);
    swap_commands(way, s);
    swap_session(way, s);
    swap_faults(way, s);
    swap_outbox(way, s);
    return (size_t)(way->at - start);
}

size_t flat_dump(const ctl_state *state, int64_t *to) {
    ctl_state copy = *state; /* what lies beyond a count is written as zero */
    walk way = {to, false};
    return swap_all(&way, &copy);
}

size_t flat_load(ctl_state *state, const int64_t *from) {
    walk way = {(int64_t *)from, true};
    return swap_all(&way, state);
}
