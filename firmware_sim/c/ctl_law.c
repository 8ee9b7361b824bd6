/* The 1 kHz torque law: guidance, support, allowance, ramps (torque.py, law/guidance.py, law/support.py, law/allowance.py).
 *
 * Only ctl_assisting can raise assist; everything else can only lower it.
 */
#include "ctl_parts.h"

/* Sine in per mille by table and linear interpolation; any angle. */
static int64_t sine_per_mille(int64_t angle_mdeg) {
    int64_t quarter = angle_mdeg % 360000;
    int64_t sign = 1;
    if (quarter < 0) {
        quarter += 360000;
    }
    if (quarter >= 180000) {
        quarter -= 180000;
        sign = -1;
    }
    if (quarter > 90000) {
        quarter = 180000 - quarter;
    }
    int64_t degree = quarter / 1000;
    int64_t rise = degree < 90 ? ctl_sine[degree + 1] - ctl_sine[degree] : 0;
    return sign * (ctl_sine[degree] + rise * (quarter % 1000) / 1000);
}

int64_t ctl_follow_torque(int64_t angle_mdeg, int64_t velocity_mdeg_s) {
    return ctl_floor_div(CTL_DEVICE_WEIGHT_UNM * sine_per_mille(angle_mdeg), 1000) + velocity_mdeg_s * 14 / 10;
}

/* Authority falls as the wearer's slow torque goes against what pushes, and comes back slowly. */
static void opposed(ctl_torque *torque) {
    int64_t push = torque->gravity_unm + torque->guide_unm;
    int64_t user = ctl_floor_shift(torque->user_mean, 10);
    int64_t opposing = 0;
    int64_t allowed = 1000;
    if ((user < 0 && push > 0) || (user > 0 && push < 0)) {
        opposing = (ctl_abs(user) * ctl_min(ctl_abs(push), 1 << CTL_PUSH_SHIFT)) >> CTL_PUSH_SHIFT;
    }
    if (opposing >= CTL_OPPOSE_TO_UNM) {
        allowed = 0;
    } else if (opposing > CTL_OPPOSE_FROM_UNM) {
        allowed = (CTL_OPPOSE_TO_UNM - opposing) * 1000 / (CTL_OPPOSE_TO_UNM - CTL_OPPOSE_FROM_UNM);
    }
    torque->authority = ctl_min(allowed, torque->authority + CTL_AUTHORITY_RISE_PER_MS);
}

/* Share of the push that the work still allows, per mille. */
static int64_t work_left(const ctl_torque *torque) {
    return ctl_max(0, ctl_min(CTL_WORK - torque->work, CTL_WORK_FADE)) * 1000 / CTL_WORK_FADE;
}

/* Count what this tick gives to the arm, each part by itself. */
static void spend(ctl_torque *torque, int64_t velocity_mdeg_s) {
    int64_t guiding_power = torque->guide_unm * velocity_mdeg_s;
    int64_t carrying_power = torque->gravity_unm * velocity_mdeg_s;
    torque->work += (ctl_max(0, guiding_power) >> 20) + (ctl_max(0, carrying_power) >> 20);
}

/* Counts how long the voluntary velocity has kept one direction above the onset speed. */
static void onset(ctl_torque *torque) {
    int64_t slow = ctl_floor_shift(torque->slow_mean, 10);
    int64_t direction = 0;
    if (ctl_abs(slow) >= CTL_ONSET_MDEG_S) {
        direction = slow > 0 ? 1 : -1;
    }
    if (direction == 0 || direction != torque->direction) {
        torque->direction = direction;
        torque->onset_ticks = 0;
    } else {
        torque->onset_ticks++;
    }
}

/* The end of the guided reach is close. */
static bool near_target(const ctl_torque *torque, int64_t angle_mdeg) {
    int64_t target = torque->guide_from_mdeg + torque->direction * CTL_REACH_MDEG;
    return torque->guide_tick > 0 && ctl_abs(target - angle_mdeg) < CTL_NEAR_MDEG;
}

/* Whether guidance runs, after it has begun where the wearer's onset calls for it. */
static bool guiding(ctl_torque *torque, const ctl_profile *profile, int64_t angle_mdeg) {
    if (torque->guide_tick == 0) {
        if (torque->onset_ticks < CTL_ONSET_TICKS || profile->guidance == CTL_GUIDANCE_NEVER) {
            return false;
        }
        torque->guide_tick = 1;
        torque->guide_from_mdeg = angle_mdeg;
        torque->contact_ticks = 0;
        torque->fade_ticks = 0;
    }
    if (profile->guidance == CTL_GUIDANCE_MINIMUM_JERK && torque->direction == 0) {
        torque->guide_tick = 0;
        return false;
    }
    return true;
}

/* The push along a minimum-jerk reach, or constant until contact; `over` says that its end is reached. */
static int64_t full_push(ctl_torque *torque, const ctl_profile *profile, int64_t angle_mdeg, bool *over) {
    int64_t direction = torque->direction;
    if (profile->guidance == CTL_GUIDANCE_MINIMUM_JERK) {
        int64_t reached = ctl_reached[ctl_min(torque->guide_tick * 100 / CTL_REACH_TICKS, 100)];
        int64_t wanted = torque->guide_from_mdeg + ctl_floor_div(direction * CTL_REACH_MDEG * reached, 1000);
        *over = torque->guide_tick > CTL_REACH_TICKS;
        return ctl_clamp(CTL_GUIDE_STIFFNESS * (wanted - angle_mdeg), CTL_GUIDE_UNM);
    }
    bool slow = ctl_abs(ctl_floor_shift(torque->slow_mean, 10)) < CTL_CONTACT_MDEG_S;
    torque->contact_ticks = slow ? torque->contact_ticks + 1 : 0;
    *over = torque->contact_ticks >= CTL_CONTACT_TICKS;
    return CTL_GUIDE_UNM * direction;
}

static int64_t guided(ctl_torque *torque, const ctl_profile *profile, int64_t angle_mdeg) {
    bool over = false;
    if (!guiding(torque, profile, angle_mdeg)) {
        return 0;
    }
    int64_t push = full_push(torque, profile, angle_mdeg, &over);
    torque->guide_tick++;
    if (push * torque->direction <= 0) {
        push = 0;
    }
    if (over || torque->fade_ticks != 0) {
        int64_t left = ctl_max(0, profile->ramp_out_ms - torque->fade_ticks);
        push = ctl_floor_div(push * left, profile->ramp_out_ms);
        torque->fade_ticks++;
        if (torque->fade_ticks > profile->ramp_out_ms) {
            torque->guide_tick = 0;
            torque->fade_ticks = 0;
            torque->onset_ticks = 0;
        }
    }
    return push;
}

static void guide(ctl_torque *torque, const ctl_profile *profile, int64_t angle_mdeg, int64_t scale) {
    int64_t push = ctl_floor_div(guided(torque, profile, angle_mdeg) * scale, 1000);
    torque->guide_unm += ctl_clamp(push - torque->guide_unm, CTL_GUIDE_RATE_UNM_PER_MS);
}

/* One tick of gravity support towards the profile's share of the arm's weight, scaled (per mille). */
static void support(ctl_torque *torque, const ctl_profile *profile, int64_t angle_mdeg, int64_t scale) {
    int64_t most = (int64_t)CTL_ARM_WEIGHT_UNM * profile->gravity_per_mille / 1000;
    int64_t wanted = ctl_floor_div(ctl_floor_div(most * sine_per_mille(angle_mdeg), 1000) * scale, 1000);
    int64_t before = torque->gravity_unm;
    if (wanted >= before) {
        torque->gravity_unm = ctl_min(wanted, before + most / profile->ramp_in_ms);
        torque->gravity_top_unm = ctl_max(torque->gravity_top_unm, torque->gravity_unm);
    } else {
        int64_t lowest = before - torque->gravity_top_unm / CTL_WAY_TICKS - 1;
        torque->gravity_unm = ctl_max(ctl_max(wanted, lowest), 0);
    }
    torque->gravity_from_unm = torque->gravity_unm;
    torque->gravity_tick = 0;
}

/* One tick of the 500 ms in which support fades, on one smooth curve. */
static void support_less(ctl_torque *torque) {
    int64_t tick = ctl_min(torque->gravity_tick + 1, CTL_WAY_TICKS);
    torque->gravity_tick = tick;
    torque->gravity_unm = torque->gravity_from_unm * ctl_way[tick] / 1000000;
    if (tick == CTL_WAY_TICKS) {
        torque->gravity_top_unm = 0;
    }
}

void ctl_support_gone(ctl_torque *torque) {
    torque->gravity_unm = 0;
    torque->gravity_from_unm = 0;
    torque->gravity_tick = CTL_WAY_TICKS;
    torque->gravity_top_unm = 0;
}

void ctl_assisting(ctl_torque *torque, const ctl_profile *profile, int64_t angle_mdeg, int64_t velocity_mdeg_s) {
    int64_t ticks = ctl_min(torque->assist_ticks + 1, profile->ramp_in_ms);
    torque->assist_ticks = ticks;
    opposed(torque);
    onset(torque);
    int64_t scale = torque->authority * work_left(torque) / 1000;
    guide(torque, profile, angle_mdeg, scale * ticks / profile->ramp_in_ms);
    support(torque, profile, angle_mdeg, scale);
    /* What pushes comes off the cap first, so that both parts together stay below it. */
    int64_t cap = profile->cap_unm * ticks / profile->ramp_in_ms;
    int64_t room = cap - ctl_abs(torque->guide_unm + torque->gravity_unm);
    int64_t size = ctl_wanted(torque, profile, velocity_mdeg_s, near_target(torque, angle_mdeg));
    ctl_damp(torque, size, room, velocity_mdeg_s);
    torque->assist_unm = torque->damping_unm + torque->guide_unm;
    torque->damping_from_unm = torque->damping_unm;
    torque->guide_from_unm = torque->guide_unm;
    torque->ramp_tick = 0;
    spend(torque, velocity_mdeg_s);
}

/* One tick of a jerk-limited way to zero assist. |assist| never rises here, and it never begins anew. */
void ctl_ramping(ctl_torque *torque, int64_t stride, int64_t velocity_mdeg_s) {
    int64_t before = torque->assist_unm;
    torque->ramp_tick = ctl_min(torque->ramp_tick + stride, CTL_RAMP_TICKS);
    torque->guide_unm = torque->guide_from_unm * ctl_remaining[torque->ramp_tick] / 1000;
    ctl_damp_less(torque, velocity_mdeg_s);
    int64_t both = torque->guide_unm + torque->damping_unm;
    torque->assist_unm = both * before > 0 ? ctl_clamp(both, ctl_abs(before)) : 0;
    torque->assist_ticks = 0;
    torque->guide_tick = 0;
    torque->onset_ticks = 0;
}

/* One tick of both, the ramp and the fading of support; at rest, where most ticks are, nothing is left to do. */
void ctl_letting_go(ctl_torque *torque, int64_t velocity_mdeg_s) {
    if (torque->assist_unm != 0 || torque->gravity_unm != 0 || torque->ramp_tick < CTL_RAMP_TICKS ||
        torque->gravity_tick < CTL_WAY_TICKS) {
        ctl_ramping(torque, 1, velocity_mdeg_s);
        support_less(torque);
        spend(torque, velocity_mdeg_s);
    }
    torque->work = ctl_max(0, torque->work - CTL_WORK_BACK_PER_MS);
}

void ctl_at_rest(ctl_torque *torque) {
    torque->assist_unm = 0;
    torque->damping_unm = 0;
    torque->guide_unm = 0;
    torque->damping_from_unm = 0;
    torque->guide_from_unm = 0;
    torque->ramp_tick = 0;
    torque->assist_ticks = 0;
    torque->guide_tick = 0;
    ctl_support_gone(torque);
}
