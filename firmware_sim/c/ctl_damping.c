/* Added damping and the filters below it (law/damping.py, law/filters.py). Its torque is against the velocity, or zero. */
#include <string.h>

#include "ctl_parts.h"

/* Torque in uN m of so many mN m s/rad at a speed. */
static int64_t viscous(int64_t damping, int64_t speed_mdeg_s) { return damping * speed_mdeg_s * 17453 / 1000000; }

/* Speed of the tremor that is to be damped in this tick; 0 where nothing swings both ways. */
static int64_t tremor(const ctl_torque *torque, int64_t half_wave_ms, int64_t velocity_mdeg_s) {
    int64_t fast = torque->fast_mdeg_s;
    bool same_way = (fast > 0 && velocity_mdeg_s > 0) || (fast < 0 && velocity_mdeg_s < 0);
    if (!same_way || torque->wave_ticks > half_wave_ms) {
        return 0;
    }
    if (torque->last_ticks > half_wave_ms || torque->before_ticks > half_wave_ms) {
        return 0;
    }
    return ctl_min(ctl_min(ctl_abs(velocity_mdeg_s), ctl_abs(fast)), ctl_min(torque->last_peak, torque->before_peak));
}

/* Size of the damping torque that the profile asks for. */
int64_t ctl_wanted(const ctl_torque *torque, const ctl_profile *profile, int64_t velocity_mdeg_s, bool near) {
    int64_t damping = near ? profile->damping_near : profile->damping;
    int64_t speed = tremor(torque, profile->half_wave_ms, velocity_mdeg_s);
    int64_t size = viscous(ctl_min(damping, torque->gain_most), speed);
    if (torque->guide_tick != 0 && !near) {
        return size; /* guidance goes along with the slow movement */
    }
    return ctl_max(size, ctl_min(profile->drag_unm, viscous(damping, ctl_abs(velocity_mdeg_s))));
}

/* What damping may still give to this side. */
static int64_t leash(const ctl_torque *torque, int64_t sign) {
    return ctl_floor_shift(CTL_LEASH_UNM_MS - sign * torque->impulse, CTL_LEASH_SHIFT);
}

static int64_t against(int64_t velocity_mdeg_s) { return velocity_mdeg_s > 0 ? -1 : 1; }

/* One tick towards `size` against the velocity: within the room, the leash and the rates; never along with it. */
void ctl_damp(ctl_torque *torque, int64_t size, int64_t room, int64_t velocity_mdeg_s) {
    int64_t sign = against(velocity_mdeg_s);
    int64_t before = ctl_max(0, sign * torque->damping_unm); /* what would push is gone at once */
    int64_t lowest = torque->peaks[0];
    for (size_t at = 1; at < CTL_WINDOW_SLOTS; at++) {
        lowest = ctl_min(lowest, torque->peaks[at]);
    }
    size = ctl_min(size, ctl_min(room, lowest + CTL_WINDOW_RISE_UNM));
    size = ctl_min(size, ctl_min(leash(torque, sign), before + CTL_RATE_UP_UNM_PER_MS));
    int64_t slowly = ctl_min(before - CTL_RATE_DOWN_UNM_PER_MS, viscous(CTL_STRONGEST, ctl_abs(velocity_mdeg_s)));
    torque->damping_unm = sign * ctl_max(0, ctl_max(size, slowly));
}

/* Damping on a ramp: below the ramp, below what it was, and still never along with the velocity. */
void ctl_damp_less(ctl_torque *torque, int64_t velocity_mdeg_s) {
    int64_t sign = against(velocity_mdeg_s);
    int64_t left = ctl_floor_div(sign * torque->damping_from_unm * ctl_remaining[torque->ramp_tick], 1000);
    int64_t most = ctl_min(left, ctl_min(leash(torque, sign), viscous(CTL_STRONGEST, ctl_abs(velocity_mdeg_s))));
    torque->damping_unm = sign * ctl_max(0, ctl_min(sign * torque->damping_unm, most));
}

/* A half wave ended: the two before it move on. */
static void next_wave(ctl_torque *torque, bool up, int64_t size) {
    torque->before_ticks = torque->last_ticks;
    torque->before_peak = torque->last_peak;
    torque->last_ticks = torque->wave_ticks;
    torque->last_peak = torque->wave_peak;
    torque->wave_up = up;
    torque->wave_ticks = 1;
    torque->wave_peak = size;
    torque->gain_most = torque->last_ticks * CTL_GAIN / ctl_max(torque->last_peak, 1);
}

/* One tick of every filter, and of the 250 ms window. They run in every state and know no profile. */
void ctl_track(ctl_torque *torque, int64_t velocity_mdeg_s, int64_t user_unm) {
    int64_t fast = velocity_mdeg_s - ctl_floor_shift(torque->slow_mean, 10);
    torque->slow_mean += CTL_SPLIT * fast;
    torque->fast_mdeg_s = fast;
    int64_t wave = fast - ctl_floor_shift(torque->second_mean, 10);
    torque->second_mean += CTL_SPLIT * wave;
    torque->user_mean += CTL_USER * (user_unm - ctl_floor_shift(torque->user_mean, 10));
    torque->impulse += torque->damping_unm - ctl_floor_shift(torque->impulse, CTL_FORGETS);
    bool up = wave > 0;
    int64_t size = ctl_abs(fast);
    if (up != (torque->wave_up != 0)) {
        next_wave(torque, up, size);
    } else {
        torque->wave_peak = ctl_max(torque->wave_peak, size);
        torque->wave_ticks = ctl_min(torque->wave_ticks + 1, CTL_NEVER_TICKS);
    }
    torque->slot_tick++;
    if (torque->slot_tick >= CTL_WINDOW_SLOT_MS) {
        torque->slot_tick = 0;
        memmove(torque->peaks, torque->peaks + 1, sizeof torque->peaks - sizeof torque->peaks[0]);
        torque->peaks[CTL_WINDOW_SLOTS - 1] = ctl_abs(torque->assist_unm);
    }
}
