/* The controller's 1 kHz step (controller.py): device faults, frames, deadlines, torque, transmission, in this order. */
#include <string.h>

#include "ctl_parts.h"

const ctl_limits ctl_default_limits = {0, 145000, 400000, 600000};

/* Within bounds that keep every watchdog alive. */
static bool limits_valid(const ctl_limits *limits) {
    return limits->angle_low_mdeg >= -20000 && limits->angle_low_mdeg < limits->angle_high_mdeg &&
           limits->angle_high_mdeg <= 160000 && limits->speed_limit_mdeg_s > 0 &&
           limits->speed_limit_mdeg_s <= 600000 && limits->tracking_limit_unm > 0 &&
           limits->tracking_limit_unm <= 1000000;
}

bool ctl_init(ctl_state *state, const uint8_t key[CTL_KEY_LENGTH], uint32_t boot_nonce, const ctl_limits *limits) {
    memset(state, 0, sizeof *state);
    memcpy(state->shared_key, key, CTL_KEY_LENGTH);
    state->boot_nonce = boot_nonce;
    state->limits = *limits;
    state->torque.gravity_tick = CTL_WAY_TICKS;
    state->torque.authority = 1000;
    state->torque.wave_ticks = CTL_NEVER_TICKS;
    state->torque.last_ticks = CTL_NEVER_TICKS;
    state->torque.before_ticks = CTL_NEVER_TICKS;
    state->meas_due_ms = 10;
    state->heartbeat_due_ms = 5;
    state->diag_due_ms = 15;
    return limits_valid(limits);
}

/* Known answers of CRC and MAC: what the device proves about its own code before it follows anybody. */
static bool self_test_passed(void) {
    static const uint8_t key[] = {0x2b, 0x7e, 0x15, 0x16, 0x28, 0xae, 0xd2, 0xa6,
                                  0xab, 0xf7, 0x15, 0x88, 0x09, 0xcf, 0x4f, 0x3c};
    static const uint8_t message[] = {0x6b, 0xc1, 0xbe, 0xe2, 0x2e, 0x40, 0x9f, 0x96,
                                      0xe9, 0x3d, 0x7e, 0x11, 0x73, 0x93, 0x17, 0x2a};
    static const uint8_t expected[] = {0x07, 0x0a, 0x16, 0xb4, 0x6b, 0x4d, 0x41, 0x44,
                                       0xf7, 0x9b, 0xdd, 0x9d, 0xd0, 0x4a, 0x28, 0x7c};
    static const uint8_t digits[] = {'1', '2', '3', '4', '5', '6', '7', '8', '9'};
    uint8_t mac[16];
    ctl_cmac(key, message, sizeof message, mac);
    return memcmp(mac, expected, sizeof mac) == 0 && ctl_crc16(digits, sizeof digits, 0xFFFF) == 0x29B1;
}

static bool within(int64_t value, int64_t lowest, int64_t highest) { return value >= lowest && value <= highest; }

/* A leaky counter after one more tick. It stops one rise above its limit. */
static int32_t leaked(int32_t doubt, bool bad, int32_t rise, int32_t limit) {
    if (bad) {
        return doubt < limit ? doubt + rise : limit + rise;
    }
    return doubt > 0 ? doubt - 1 : 0;
}

/* Whether this tick's readings cannot be true; the doubt that such ticks leave leaks away slowly. */
static bool sensors_bad(ctl_state *state, const ctl_inputs *inputs) {
    int64_t angle = inputs->angle_mdeg;
    int64_t moved = state->moved_before ? angle - state->previous_mdeg : 0;
    int64_t user = inputs->user_torque_unm;
    bool good = within(angle - inputs->second_angle_mdeg, -3000, 3000) && within(angle, -40000, 200000) &&
                within(moved, -5000, 5000) && within(inputs->velocity_mdeg_s - 1000 * moved, -30000, 30000) &&
                within(user, -20000000, 20000000) && within(user - state->previous_user_unm, -5000000, 5000000);
    state->moved_before = true;
    state->previous_mdeg = inputs->angle_mdeg;
    state->previous_user_unm = inputs->user_torque_unm;
    state->sensor_doubt = leaked(state->sensor_doubt, !good, CTL_SENSOR_RISE, CTL_SENSOR_DOUBT);
    return !good;
}

static void plant_faults(ctl_state *state, const ctl_inputs *inputs) {
    const ctl_limits *limits = &state->limits;
    int64_t now_ms = inputs->now_ms;
    bool astray = ctl_abs((int64_t)inputs->commanded_unm - inputs->measured_unm) > limits->tracking_limit_unm;
    state->tracking_doubt = leaked(state->tracking_doubt, astray, CTL_TRACKING_RISE, CTL_TRACKING_DOUBT);
    if (state->tracking_doubt >= CTL_TRACKING_DOUBT) {
        ctl_fire(state, CTL_EVENT_LATCH, CTL_REASON_TORQUE_TRACKING, now_ms);
    }
    if (ctl_abs(inputs->velocity_mdeg_s) > limits->speed_limit_mdeg_s) {
        ctl_fire(state, CTL_EVENT_LATCH, CTL_REASON_JOINT_SPEED, now_ms);
    }
    if (!within(inputs->angle_mdeg, limits->angle_low_mdeg, limits->angle_high_mdeg)) {
        ctl_fire(state, CTL_EVENT_LATCH, CTL_REASON_RANGE_OF_MOTION, now_ms);
    }
}

/* What the device can tell about itself: its tick, its transceiver, its sensors, its actuator, its arm. */
static void device_faults(ctl_state *state, const ctl_inputs *inputs) {
    int64_t now_ms = inputs->now_ms;
    ctl_count(state, CTL_COUNT_STALL_TICKS, inputs->stall_ticks);
    ctl_count(state, CTL_COUNT_TX_DROPPED, inputs->tx_dropped);
    if (now_ms - state->last_tick_ms >= CTL_TICK_LIMIT_MS && state->last_tick_ms != 0) {
        ctl_fire(state, CTL_EVENT_LATCH, CTL_REASON_TICK_OVERRUN, now_ms);
    }
    if (inputs->bus_off && !state->was_bus_off) {
        ctl_count(state, CTL_COUNT_BUS_OFFS, 1);
        ctl_bus_off(state, now_ms);
    }
    state->was_bus_off = inputs->bus_off;
    if (sensors_bad(state, inputs)) {
        state->healthy_ticks = 0;
        if (state->sensor_doubt >= CTL_SENSOR_DOUBT) {
            ctl_disarm(state);
            ctl_fire(state, CTL_EVENT_SENSORS_BAD, CTL_REASON_SENSOR_IMPLAUSIBLE, now_ms);
        }
        return;
    }
    state->healthy_ticks++;
    if (state->state == CTL_STATE_PASSIVE && state->healthy_ticks >= CTL_HEALTHY_TICKS) {
        ctl_fire(state, CTL_EVENT_SENSORS_GOOD, CTL_REASON_SENSOR_IMPLAUSIBLE, now_ms);
    }
    plant_faults(state, inputs);
}

/* Zero torque, HOLD present and an authenticated challenge; the local action is the caller's. */
static bool may_clear(const ctl_state *state, int64_t now_ms) {
    bool at_rest = state->torque.assist_unm == 0 && state->torque.gravity_unm == 0;
    return at_rest && state->command_live && state->command_is_hold && now_ms < state->clear_until_ms;
}

static void start_up(ctl_state *state, const ctl_inputs *inputs) {
    int64_t now_ms = inputs->now_ms;
    if (state->state == CTL_STATE_BOOT) {
        ctl_fire(state, CTL_EVENT_BOOTED, CTL_REASON_NONE, now_ms);
    } else if (state->state == CTL_STATE_SELFTEST && now_ms - state->self_test_ms >= CTL_SELF_TEST_MS) {
        if (inputs->self_test_ok && limits_valid(&state->limits) && self_test_passed()) {
            ctl_fire(state, CTL_EVENT_SELFTEST_PASSED, CTL_REASON_NONE, now_ms);
        } else {
            ctl_fire(state, CTL_EVENT_LATCH, CTL_REASON_SELF_TEST_FAILED, now_ms);
        }
    }
}

/* Everything that happens because time went by. */
static void deadlines(ctl_state *state, const ctl_inputs *inputs) {
    int64_t now_ms = inputs->now_ms;
    start_up(state, inputs);
    if (state->pending.waits && !ctl_fresh(state->pending.arrived_ms, now_ms, CTL_AUTH_LIMIT_MS)) {
        ctl_authorisation_missing(state, now_ms);
    }
    if (state->command_live && now_ms - state->command_ms >= CTL_COMMAND_LIMIT_MS) {
        ctl_command_overdue(state, now_ms);
    }
    if (state->armed && now_ms - state->heartbeat_ms >= CTL_HEARTBEAT_LIMIT_MS) {
        ctl_disarm(state);
        ctl_trip(state, CTL_REASON_HEARTBEAT_TIMEOUT, now_ms);
    }
    if (state->state == CTL_STATE_ASSIST && now_ms - state->assist_since_ms >= CTL_DWELL_LIMIT_MS) {
        ctl_fire(state, CTL_EVENT_FAULT, CTL_REASON_ASSIST_DWELL, now_ms);
    }
    if (inputs->local_clear && may_clear(state, now_ms)) {
        state->trip_count = 0;
        state->bus_off_count = 0;
        state->mac_failures = 0;
        state->clear_until_ms = 0;
        ctl_fire(state, CTL_EVENT_CLEAR, CTL_REASON_CLEARED, now_ms);
    }
}

/* The torque law of the state; and the end of a ramp, which is an event. */
static void torque_of_state(ctl_state *state, const ctl_inputs *inputs) {
    ctl_torque *law = &state->torque;
    uint8_t current = state->state;
    int64_t velocity = inputs->velocity_mdeg_s;
    ctl_track(law, velocity, inputs->user_torque_unm);
    if (current == CTL_STATE_ASSIST) {
        ctl_assisting(law, &ctl_profiles[state->verb], inputs->angle_mdeg, velocity);
    } else if (current == CTL_STATE_PASSIVE) {
        ctl_at_rest(law);
    } else if (current == CTL_STATE_ESTOP) {
        ctl_ramping(law, CTL_STOP_STRIDE, velocity);
        ctl_support_gone(law);
    } else if (state->sensor_doubt >= CTL_SENSOR_DOUBT) {
        ctl_ramping(law, 1, velocity);
        ctl_support_gone(law);
    } else {
        ctl_letting_go(law, velocity);
    }
    if (current == CTL_STATE_RAMP_DOWN && law->assist_unm == 0) {
        uint8_t done = state->ramp_fault ? CTL_EVENT_RAMPED_FAULT : CTL_EVENT_RAMPED_CLEAN;
        ctl_fire(state, done, state->reason, inputs->now_ms);
    }
}

/* Whether the device cannot or must not carry its own weight. Plant faults are reasons of a latch alone. */
static bool no_follow(const ctl_state *state) {
    switch (state->reason) {
    case CTL_REASON_TORQUE_TRACKING:
    case CTL_REASON_JOINT_SPEED:
    case CTL_REASON_RANGE_OF_MOTION:
        return true;
    default:
        return state->state <= CTL_STATE_SELFTEST || state->state == CTL_STATE_PASSIVE ||
               state->sensor_doubt >= CTL_SENSOR_DOUBT;
    }
}

void ctl_step(ctl_state *state, const ctl_inputs *inputs, ctl_outputs *outputs) {
    uint8_t began = state->state;
    state->outbox_count = 0;
    state->mac_checked = false;
    device_faults(state, inputs);
    for (size_t at = 0; at < inputs->count; at++) {
        ctl_receive(state, &inputs->frames[at], inputs->random_u32, inputs->now_ms);
    }
    deadlines(state, inputs);
    torque_of_state(state, inputs);
    ctl_send_cyclic(state, inputs, state->state != began);
    state->last_tick_ms = inputs->now_ms;
    state->follow_unm = no_follow(state) ? 0 : ctl_follow_torque(inputs->angle_mdeg, inputs->velocity_mdeg_s);
    outputs->frames = state->outbox;
    outputs->count = state->outbox_count;
    outputs->assist_unm = state->torque.assist_unm;
    outputs->gravity_unm = state->torque.gravity_unm;
    outputs->follow_unm = state->follow_unm;
}
