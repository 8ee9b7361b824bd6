/* What a board gives the controller: five functions (docs/porting.md). */
#ifndef PORT_H
#define PORT_H

#include "../ctl.h"

/* The next frame that has arrived; false when there is none. */
bool port_receive(ctl_frame *frame);

/* Hand a frame to the transceiver; false where it cannot be sent, which is counted. Never waits. */
bool port_send(const ctl_sent *frame);

/* Wait for the next millisecond; its number on a clock that never jumps back. */
int64_t port_tick(void);

/* Put out the torque of the last tick and read the joint: angles, velocity, torques, bus_off, self_test_ok, local_clear. */
void port_joint(int64_t torque_unm, ctl_inputs *inputs);

/* 32 bits that nobody can foretell. */
uint32_t port_random(void);

/* The loop: never returns. */
void port_run(const uint8_t key[CTL_KEY_LENGTH], const ctl_limits *limits);

#endif
