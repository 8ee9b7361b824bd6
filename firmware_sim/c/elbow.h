/* The simulated elbow and its motor, for runs in virtual time: the same sums as firmware_sim/plant/arm.py and actuator.py, to the bit.
 *
 * No part of the controller: a board has an arm of its own. Angle in rad, torque in N m.
 */
#ifndef ELBOW_H
#define ELBOW_H

#include <float.h>

#include "ctl.h"
#include "elbow_numbers.h"

#if FLT_EVAL_METHOD != 0
#error "sums in another precision are not those of Python"
#endif

typedef struct {
    long wearer; /* place in plant.arm.WEARERS */
    double angle, velocity, torque_nm, gain, lag_s, bias_nm, extra_nm;
    int64_t encoder_offset_mdeg, commanded_unm;
} elbow;

/* What the wearer's muscles do at a time; `elbow_read` gives the controller's inputs, `elbow_move` the tick that follows. */
double elbow_wearer_nm(const elbow *one, double at_s);
void elbow_read(const elbow *one, double wearer_nm, ctl_inputs *inputs);
void elbow_move(elbow *one, double wearer_nm, const ctl_outputs *outputs);

#endif
