/* A core whose AES is a chip's own, and wrong; and limits that are not valid. Exit 0 where each latches at the self-test, and
 * where a right engine with valid limits passes. Compiled with CTL_OWN_AES.
 */
#include <stdio.h>
#include <string.h>

#include "../ctl_parts.h"

static const uint8_t ANSWER[16] = {0x07, 0x0a, 0x16, 0xb4, 0x6b, 0x4d, 0x41, 0x44,
                                    0xf7, 0x9b, 0xdd, 0x9d, 0xd0, 0x4a, 0x28, 0x7c};

/* Not AES at all: the one answer that the self-test's vector needs, or another. */
static int wrong;

void ctl_aes128(const uint8_t key[CTL_KEY_LENGTH], const uint8_t in[16], uint8_t out[16]) {
    (void)key;
    (void)in;
    memcpy(out, ANSWER, sizeof ANSWER);
    out[0] = (uint8_t)(out[0] ^ (uint8_t)wrong);
}

/* The state after the self-test. */
static uint8_t after(const ctl_limits *limits) {
    static const uint8_t key[CTL_KEY_LENGTH] = {1};
    static ctl_state state;
    ctl_inputs inputs = {.angle_mdeg = 30000, .second_angle_mdeg = 30000, .self_test_ok = true};
    ctl_outputs outputs;
    (void)ctl_init(&state, key, 7, limits);
    for (inputs.now_ms = 1; inputs.now_ms < 100; inputs.now_ms++) {
        ctl_step(&state, &inputs, &outputs);
    }
    return state.state;
}

int main(void) {
    ctl_limits narrow = ctl_default_limits;
    narrow.angle_high_mdeg = narrow.angle_low_mdeg;
    wrong = 1;
    uint8_t broken = after(&ctl_default_limits);
    wrong = 0;
    uint8_t invalid = after(&narrow);
    uint8_t well = after(&ctl_default_limits);
    (void)printf("%u %u %u\n", broken, invalid, well);
    return broken == CTL_STATE_LATCHED && invalid == CTL_STATE_LATCHED && well == CTL_STATE_FOLLOW ? 0 : 1;
}
