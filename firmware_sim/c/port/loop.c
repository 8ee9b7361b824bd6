/* The controller's loop over the five functions of a board. All memory is fixed. */
#include "port.h"

#define MOST_FRAMES 16 /* more than a bus of 1 Mbit/s carries within a millisecond; the rest waits for the next */

void port_run(const uint8_t key[CTL_KEY_LENGTH], const ctl_limits *limits) {
    static ctl_state state;
    static ctl_frame frames[MOST_FRAMES];
    static ctl_inputs inputs = {.frames = frames};
    ctl_outputs outputs = {0};
    (void)ctl_init(&state, key, port_random(), limits);
    for (;;) {
        inputs.now_ms = port_tick();
        inputs.count = 0;
        while (inputs.count < MOST_FRAMES && port_receive(&frames[inputs.count])) {
            inputs.count++;
        }
        inputs.random_u32 = port_random();
        port_joint(outputs.assist_unm + outputs.gravity_unm + outputs.follow_unm, &inputs);
        ctl_step(&state, &inputs, &outputs);
        inputs.tx_dropped = 0;
        for (size_t at = 0; at < outputs.count; at++) {
            inputs.tx_dropped += !port_send(&outputs.frames[at]);
        }
    }
}
