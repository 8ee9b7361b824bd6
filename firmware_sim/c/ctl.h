/* The controller: its memory, what it reads and puts out in a tick, and its two functions.
 *
 * The Python modules of firmware_sim are the readable reference; each function here names the same step. Integers only:
 * ms of the device's own clock, mdeg, mdeg/s, uN m. Nothing here allocates, recurses, or reads a clock.
 */
#ifndef CTL_H
#define CTL_H

#include <stddef.h>

#include "ctl_tables.h"

#define CTL_KEY_LENGTH 16

/* A frame of this tick. `plain` is false for an error, remote, extended or FD frame. */
typedef struct {
    uint32_t can_id;
    bool plain;
    uint8_t length; /* 255 for 255 and more */
    uint8_t data[CTL_FRAME_LENGTH];
} ctl_frame;

/* `random_u32` must be unpredictable. `stall_ticks` and `tx_dropped` are new counts since the last tick, for DIAG. */
typedef struct {
    const ctl_frame *frames;
    size_t count;
    int64_t now_ms; /* one more every tick; a gap of 5 ms latches */
    int32_t angle_mdeg, second_angle_mdeg, velocity_mdeg_s;
    int32_t user_torque_unm, measured_unm, commanded_unm;
    uint32_t random_u32, stall_ticks, tx_dropped;
    bool bus_off, self_test_ok, local_clear;
} ctl_inputs;

typedef struct {
    uint16_t can_id;
    uint8_t data[CTL_FRAME_LENGTH];
} ctl_sent;

/* `frames` lie in the state and stand until the next tick. */
typedef struct {
    const ctl_sent *frames;
    size_t count;
    int64_t assist_unm, gravity_unm, follow_unm;
} ctl_outputs;

/* What a site may set, within bounds that keep every watchdog alive. */
typedef struct {
    int64_t angle_low_mdeg, angle_high_mdeg, speed_limit_mdeg_s, tracking_limit_unm;
} ctl_limits;

/* Memory of the torque law (firmware_sim/law/memory.py); wide enough that no reading can overflow it. */
typedef struct {
    int64_t assist_unm, gravity_unm, damping_unm, guide_unm, damping_from_unm, guide_from_unm;
    int64_t ramp_tick, gravity_from_unm, gravity_tick, gravity_top_unm, assist_ticks, authority, impulse, work;
    int64_t slow_mean, second_mean, fast_mdeg_s, user_mean;
    int64_t wave_up, wave_ticks, wave_peak, last_ticks, last_peak, before_ticks, before_peak, gain_most;
    int64_t onset_ticks, direction, guide_tick, guide_from_mdeg, contact_ticks, fade_ticks;
    int64_t peaks[CTL_WINDOW_SLOTS];
    int64_t slot_tick;
} ctl_torque;

typedef struct {
    bool seen; /* whether `counter` is one */
    uint8_t counter, machine, filled;
    uint8_t window[CTL_WINDOW];
    uint64_t lost;
} ctl_receiver;

typedef struct {
    int64_t arrived_ms;
    uint8_t data[CTL_FRAME_LENGTH];
    bool waited;
} ctl_command;

typedef struct {
    bool waits;
    uint8_t verb, counter;
    uint8_t data[CTL_FRAME_LENGTH];
    int64_t arrived_ms;
} ctl_pending;

typedef struct {
    int64_t sent_ms;
    uint8_t counter;
} ctl_echo;

typedef struct {
    bool open, disturbed;
    uint8_t purpose, session;
    uint32_t bridge_nonce, device_nonce;
    int64_t sent_ms;
} ctl_challenge;

/* All memory of the controller, in the order of firmware_sim/memory.py. */
typedef struct {
    uint8_t shared_key[CTL_KEY_LENGTH];
    uint32_t boot_nonce;
    ctl_limits limits;
    int64_t last_tick_ms;
    uint8_t state, reason;
    ctl_torque torque;
    bool ramp_fault;
    uint8_t verb;
    int64_t assist_since_ms, self_test_ms;
    ctl_receiver receivers[CTL_RECEIVED_COUNT];
    ctl_pending pending;
    ctl_command commands[CTL_COMMAND_SLOTS];
    uint8_t command_count;
    bool command_live, command_is_hold;
    int64_t command_ms;
    uint8_t accepted_counter, neutral;
    ctl_echo echoes[CTL_ECHO_SLOTS];
    uint8_t echo_count;
    bool armed;
    uint8_t session;
    uint8_t key[CTL_KEY_LENGTH];
    uint32_t freshness;
    bool mac_checked; /* in this tick */
    int64_t heartbeat_ms;
    ctl_challenge challenge;
    uint8_t last_session, refusal;
    int64_t handshake_rest_ms, clear_until_ms;
    int64_t trips[CTL_TRIP_LIMIT], bus_offs[CTL_BUS_OFF_LIMIT];
    uint8_t trip_count, bus_off_count;
    bool was_bus_off;
    uint32_t mac_failures;
    int32_t tracking_doubt, sensor_doubt;
    uint64_t healthy_ticks;
    bool moved_before; /* whether `previous_mdeg` is one */
    int32_t previous_mdeg, previous_user_unm;
    uint32_t counters[CTL_COUNTERS];
    uint8_t tx_counters[CTL_OWN_COUNT];
    ctl_sent outbox[CTL_OUTBOX_SLOTS];
    uint8_t outbox_count, diag_index;
    int64_t status_due_ms, meas_due_ms, heartbeat_due_ms, diag_due_ms;
    uint32_t emergencies;
    int64_t follow_unm;
} ctl_state;

/* Power-on. `boot_nonce` must be unpredictable. False where the limits are not valid; the self-test fails then. */
bool ctl_init(ctl_state *state, const uint8_t key[CTL_KEY_LENGTH], uint32_t boot_nonce, const ctl_limits *limits);

/* One millisecond. Nothing that comes from the bus can make it fail. */
void ctl_step(ctl_state *state, const ctl_inputs *inputs, ctl_outputs *outputs);

extern const ctl_limits ctl_default_limits;

#endif
