/* The whole state as whole numbers in a fixed order, for comparing, copying and the Python side (flat.py). */
#ifndef FLAT_H
#define FLAT_H

#include "ctl.h"

#define FLAT_PLAIN(X) \
    X(boot_nonce) X(last_tick_ms) X(state) X(reason) X(ramp_fault) X(verb) X(assist_since_ms) X(self_test_ms) \
    X(command_live) X(command_ms) X(command_is_hold) X(accepted_counter) X(neutral) X(armed) X(session) \
    X(freshness) X(mac_checked) X(heartbeat_ms) X(last_session) X(handshake_rest_ms) X(refusal) X(clear_until_ms) X(was_bus_off) \
    X(mac_failures) X(tracking_doubt) X(sensor_doubt) X(healthy_ticks) X(previous_user_unm) X(status_due_ms) \
    X(meas_due_ms) X(heartbeat_due_ms) X(diag_due_ms) X(diag_index) X(emergencies) X(follow_unm)
#define FLAT_LAW(X) \
    X(assist_unm) X(gravity_unm) X(damping_unm) X(guide_unm) X(damping_from_unm) X(guide_from_unm) X(ramp_tick) \
    X(gravity_from_unm) X(gravity_tick) X(gravity_top_unm) X(assist_ticks) X(authority) X(impulse) X(work) \
    X(slow_mean) X(second_mean) X(fast_mdeg_s) X(user_mean) X(wave_up) X(wave_ticks) X(wave_peak) X(last_ticks) \
    X(last_peak) X(before_ticks) X(before_peak) X(gain_most) X(onset_ticks) X(direction) X(guide_tick) \
    X(guide_from_mdeg) X(contact_ticks) X(fade_ticks) X(slot_tick)

enum { FLAT_ROOM = 512 };

/* Both give how many numbers there are. */
size_t flat_dump(const ctl_state *state, int64_t *to);
size_t flat_load(ctl_state *state, const int64_t *from);

#endif
