/* For the laboratory: what each tick costs and does, told on UART 1. Linked around ctl_step, so that the core stays as it is.
 *
 * A line at each change: L, tick, state, assist (1: zero), time of the last ACT_AUTH, of the first HOLD after it, and of the last STOP;
 * and W, tick, SysTick counts, frames: a tick that took longer than all before it. Times are the device's own ms.
 */
#include "../../ctl.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define DATA REGISTER(0x40005000U)
#define STATE REGISTER(0x40005004U)
#define SYSTICK_RELOAD REGISTER(0xE000E014U)
#define SYSTICK_VALUE REGISTER(0xE000E018U)

void __real_ctl_step(ctl_state *state, const ctl_inputs *inputs, ctl_outputs *outputs);
void __wrap_ctl_step(ctl_state *state, const ctl_inputs *inputs, ctl_outputs *outputs);

static void put(char letter) {
    while ((STATE & 1U) != 0) {
    }
    DATA = (uint32_t)letter;
}

static void tell(char kind, const uint32_t *numbers, size_t count) {
    put(kind);
    for (size_t at = 0; at < count; at++) {
        put(' ');
        for (int shift = 28; shift >= 0; shift -= 4) {
            put("0123456789ABCDEF"[numbers[at] >> shift & 15U]);
        }
    }
    put('\n');
}

void __wrap_ctl_step(ctl_state *state, const ctl_inputs *inputs, ctl_outputs *outputs) {
    static uint32_t act_ms, hold_ms, stop_ms, before, worst;
    static bool held;
    uint32_t now_ms = (uint32_t)inputs->now_ms;
    for (size_t at = 0; at < inputs->count; at++) {
        const ctl_frame *frame = &inputs->frames[at];
        if (frame->can_id == CTL_ACT_AUTH) {
            act_ms = now_ms;
            held = false;
        } else if (frame->can_id == CTL_ACT_CMD && (frame->data[3] & 3U) == CTL_GATE_HOLD && !held) {
            held = true;
            hold_ms = now_ms;
        } else if (frame->can_id == CTL_STOP) {
            stop_ms = now_ms;
        }
    }
    uint32_t began = SYSTICK_VALUE;
    __real_ctl_step(state, inputs, outputs);
    uint32_t ended = SYSTICK_VALUE;
    uint32_t took = began >= ended ? began - ended : began + SYSTICK_RELOAD + 1 - ended;
    uint32_t mark = state->state | (uint32_t)(outputs->assist_unm == 0) << 8;
    if (mark != before) {
        uint32_t numbers[] = {now_ms, state->state, outputs->assist_unm == 0, act_ms, hold_ms, stop_ms};
        before = mark;
        tell('L', numbers, sizeof numbers / sizeof numbers[0]);
    }
    if (took > worst) {
        uint32_t numbers[] = {now_ms, took, (uint32_t)inputs->count, state->state};
        worst = took;
        tell('W', numbers, sizeof numbers / sizeof numbers[0]);
    }
}
