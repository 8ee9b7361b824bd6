#include "elbow.h"

#include <math.h>

#include "ctl_parts.h"

static void wanted_path(long wearer, double at_s, double *angle, double *velocity) {
    if (wearer == ELBOW_STILL) {
        *angle = ELBOW_STILL_AT;
        *velocity = 0.0;
        return;
    }
    if (wearer == ELBOW_SWAY) {
        double turned = ELBOW_SWAY_RATE * at_s;
        *angle = (60.0 + 25.0 * sin(turned)) * ELBOW_RADIANS;
        *velocity = (25.0 * ELBOW_SWAY_RATE * cos(turned)) * ELBOW_RADIANS;
        return;
    }
    /* A reach out and back every four seconds, minimum jerk, one second each way. */
    double phase = fmod(at_s, 4.0);
    bool going = phase < 2.0;
    double s = going ? phase : phase - 2.0;
    if (s >= 1.0) {
        *angle = going ? ELBOW_LOW + ELBOW_SPAN : ELBOW_LOW;
        *velocity = 0.0;
        return;
    }
    double square = s * s;
    double moved = s * square * (10.0 + s * (6.0 * s - 15.0));
    double rate = 30.0 * square * (1.0 + s * (s - 2.0));
    *angle = going ? ELBOW_LOW + ELBOW_SPAN * moved : ELBOW_LOW + ELBOW_SPAN * (1.0 - moved);
    *velocity = going ? ELBOW_SPAN * rate : -ELBOW_SPAN * rate;
}

double elbow_wearer_nm(const elbow *one, double at_s) {
    double angle, velocity;
    wanted_path(one->wearer, at_s, &angle, &velocity);
    double own_weight = ELBOW_CARRIED_SHARE * ELBOW_ARM_WEIGHT_NM * sin(one->angle);
    double torque = own_weight + 6.0 * (angle - one->angle) + 0.8 * (velocity - one->velocity);
    if (one->wearer == ELBOW_TREMOR) {
        torque += 0.9 * sin(2.0 * ELBOW_PI * 6.0 * at_s);
    }
    return torque + one->extra_nm;
}

static int32_t saturated(int64_t value) { return (int32_t)ctl_max(INT32_MIN, ctl_min(INT32_MAX, value)); }

void elbow_read(const elbow *one, double wearer_nm, ctl_inputs *inputs) {
    int64_t angle = llrint(one->angle * ELBOW_MDEG);
    inputs->angle_mdeg = saturated(angle);
    inputs->second_angle_mdeg = saturated(angle + one->encoder_offset_mdeg);
    inputs->velocity_mdeg_s = saturated(llrint(one->velocity * ELBOW_MDEG));
    inputs->user_torque_unm = saturated(llrint(wearer_nm * 1e6) - llrint(ELBOW_CARRIED_UNM * sin(one->angle)));
    inputs->measured_unm = saturated(llrint(one->torque_nm * 1e6));
    inputs->commanded_unm = saturated(one->commanded_unm);
}

void elbow_move(elbow *one, double wearer_nm, const ctl_outputs *outputs) {
    one->commanded_unm = outputs->assist_unm + outputs->gravity_unm + outputs->follow_unm;
    double wanted = (double)one->commanded_unm * 1e-6 * one->gain + one->bias_nm;
    if (!(-ELBOW_LIMIT_NM <= wanted && wanted <= ELBOW_LIMIT_NM)) {
        wanted = wanted > 0.0 ? ELBOW_LIMIT_NM : -ELBOW_LIMIT_NM;
    }
    one->torque_nm += (wanted - one->torque_nm) * (ELBOW_TICK_S / (one->lag_s + ELBOW_TICK_S));
    double weight = (ELBOW_ARM_WEIGHT_NM + ELBOW_DEVICE_WEIGHT_NM) * sin(one->angle);
    double stop = 0.0;
    if (one->angle < ELBOW_STOP_LOW) {
        stop = ELBOW_STOP_STIFFNESS * (ELBOW_STOP_LOW - one->angle) - 2.0 * one->velocity;
    } else if (one->angle > ELBOW_STOP_HIGH) {
        stop = ELBOW_STOP_STIFFNESS * (ELBOW_STOP_HIGH - one->angle) - 2.0 * one->velocity;
    }
    double total = one->torque_nm + wearer_nm + stop - weight - ELBOW_FRICTION * one->velocity;
    one->velocity += total / (ELBOW_ARM_INERTIA + ELBOW_DEVICE_INERTIA) * ELBOW_TICK_S;
    one->angle += one->velocity * ELBOW_TICK_S;
}
