/* libFuzzer: bytes become ticks of inputs and frames, some of them made right, so that all of the controller is reached. */
#include <string.h>

#include "../ctl_parts.h"

static const uint8_t KEY[CTL_KEY_LENGTH] = "hilbridge-demo-k";

typedef struct {
    const uint8_t *at;
    size_t left;
} stream;

static uint32_t take(stream *in, size_t bytes) {
    uint32_t value = 0;
    for (; bytes > 0 && in->left > 0; bytes--, in->left--) {
        value = value << 8 | *in->at++;
    }
    return value;
}

/* CRC and counter as the receiver expects them. */
static void make_right(const ctl_state *state, uint32_t slot, ctl_frame *frame) {
    uint8_t tail[8];
    frame->plain = true;
    frame->length = CTL_FRAME_LENGTH;
    frame->can_id = ctl_received[slot].can_id;
    frame->data[2] = (uint8_t)(state->receivers[slot].counter + 1);
    memcpy(tail, frame->data + 2, 6);
    tail[6] = (uint8_t)ctl_received[slot].data_id;
    tail[7] = (uint8_t)(ctl_received[slot].data_id >> 8);
    uint16_t crc = ctl_crc16(tail, sizeof tail, 0xFFFF);
    frame->data[0] = (uint8_t)crc;
    frame->data[1] = (uint8_t)(crc >> 8);
}

static void put(ctl_frame *frame, unsigned start, uint32_t value) {
    uint64_t word = 0;
    memcpy(&word, frame->data, 8);
    word |= (uint64_t)value << start;
    memcpy(frame->data, &word, 8);
}

/* The frame that an honest bridge would send next, as far as `kind` says. */
static void honest(const ctl_state *state, uint8_t kind, ctl_frame *frame) {
    uint32_t slot = CTL_SLOT_BRIDGE_HB;
    memset(frame->data, 0, sizeof frame->data);
    if (kind < 2) { /* HOLD, ACT */
        slot = CTL_SLOT_ACT_CMD;
        uint8_t echo = state->echo_count > 0 ? state->echoes[state->echo_count - 1].counter : 0;
        put(frame, 24, kind == 0 ? CTL_GATE_HOLD : CTL_GATE_ACT);
        put(frame, 26, kind == 0 ? 0 : 1);
        put(frame, 38, state->session);
        put(frame, 46, echo);
    } else if (kind == 2) { /* ACT_AUTH */
        slot = CTL_SLOT_ACT_AUTH;
        uint32_t freshness = state->freshness + 1;
        put(frame, 24, freshness & 0xFF);
        uint8_t first[16];
        ctl_first_subkey(state->key, first);
        put(frame, 32, ctl_act_mac(state, first, freshness, state->pending.data));
    } else if (kind == 3) { /* ARM_REQUEST, also to clear */
        slot = CTL_SLOT_ARM_REQUEST;
        put(frame, 24, 7);
        put(frame, 56, state->state >= CTL_STATE_LATCHED ? CTL_PURPOSE_CLEAR_LATCH : CTL_PURPOSE_ARM);
    } else if (kind == 4) { /* ARM_RESPONSE */
        slot = CTL_SLOT_ARM_RESPONSE;
        uint8_t key[CTL_KEY_LENGTH];
        ctl_session_key(state, key);
        put(frame, 24, ctl_arm_mac(key, &state->challenge));
        put(frame, 56, state->challenge.session);
    } else {
        put(frame, 56, CTL_PROTOCOL_VERSION);
    }
    make_right(state, slot, frame);
}

static void any_frame(const ctl_state *state, stream *in, ctl_frame *frame) {
    uint8_t kind = (uint8_t)take(in, 1);
    if (kind < 160) {
        honest(state, kind % 6, frame);
        return;
    }
    frame->can_id = take(in, 2);
    frame->plain = kind % 8 != 0;
    frame->length = kind % 16 == 1 ? (uint8_t)take(in, 1) : CTL_FRAME_LENGTH;
    for (size_t at = 0; at < CTL_FRAME_LENGTH; at++) {
        frame->data[at] = (uint8_t)take(in, 1);
    }
    if (kind % 4 == 3) {
        make_right(state, kind / 4 % CTL_RECEIVED_COUNT, frame);
    }
}

static void any_readings(stream *in, ctl_inputs *inputs) {
    uint8_t odd = (uint8_t)take(in, 1);
    inputs->second_angle_mdeg = inputs->angle_mdeg = (odd & 1U) != 0 ? (int32_t)take(in, 4) : 30000;
    inputs->velocity_mdeg_s = (odd & 2U) != 0 ? (int32_t)take(in, 4) : 20000;
    inputs->user_torque_unm = (odd & 4U) != 0 ? (int32_t)take(in, 4) : 0;
    inputs->measured_unm = (odd & 8U) != 0 ? (int32_t)take(in, 4) : 0;
    inputs->commanded_unm = (odd & 16U) != 0 ? (int32_t)take(in, 4) : 0;
    inputs->bus_off = (odd & 224U) == 224U;
    inputs->local_clear = (odd & 224U) == 192U;
    inputs->stall_ticks = (odd & 224U) == 160U ? UINT32_MAX : 0;
    inputs->self_test_ok = odd != 129;
    inputs->random_u32 = 0x55667788U;
}

static void check(const ctl_state *state, const ctl_outputs *outputs) {
    bool may = state->state == CTL_STATE_ASSIST || state->state == CTL_STATE_RAMP_DOWN ||
               state->state == CTL_STATE_LATCHED || state->state == CTL_STATE_ESTOP;
    if (ctl_abs(outputs->assist_unm + outputs->gravity_unm) > 2000000 || (outputs->assist_unm != 0 && !may) ||
        outputs->count > CTL_OUTBOX_SLOTS || state->state >= CTL_STATE_COUNT) {
        __builtin_trap();
    }
    if (outputs->frames != state->outbox || outputs->follow_unm != state->follow_unm) { /* what a board reads */
        __builtin_trap();
    }
}

enum { POWER_ON, FOLLOWING, READY, ASSISTING, STARTS };

/* The same way to every start: boot, arm, hold, act, with frames of an honest bridge. */
static void prepare(ctl_state starts[STARTS]) {
    ctl_state state;
    ctl_outputs outputs;
    ctl_frame frames[3];
    ctl_inputs inputs = {.frames = frames, .angle_mdeg = 30000, .second_angle_mdeg = 30000, .velocity_mdeg_s = 20000, .self_test_ok = true};
    if (ctl_follow_torque(90000, 0) < ctl_follow_torque(89000, 0)) { /* the table's last place, and none beyond */
        __builtin_trap();
    }
    static const uint8_t unnamed[CTL_FRAME_LENGTH] = {[7] = 32}; /* a value that a table of 32 bits has no place for */
    uint32_t values[CTL_MOST_FIELDS];
    if (ctl_unpack(CTL_SLOT_ARM_REQUEST, unnamed, values) != CTL_REJECT_ENUM) {
        __builtin_trap();
    }
    static ctl_state fresh; /* what memory held before power-on is forgotten */
    memset(&state, 0xA5, sizeof state);
    (void)ctl_init(&state, KEY, 1, &ctl_default_limits);
    (void)ctl_init(&fresh, KEY, 1, &ctl_default_limits);
    if (memcmp(&state, &fresh, sizeof state) != 0) {
        __builtin_trap();
    }
    starts[POWER_ON] = state;
    for (int64_t now_ms = 1; now_ms < 400; now_ms++) {
        bool acts = state.state == CTL_STATE_READY || state.state == CTL_STATE_ASSIST;
        inputs.now_ms = now_ms;
        inputs.count = 0;
        if (now_ms == 60 || now_ms == 61) {
            starts[FOLLOWING] = state;
            honest(&state, now_ms == 60 ? 3 : 4, &frames[0]);
            inputs.count = 1;
        } else if (now_ms > 61 && now_ms % 20 == 0) {
            honest(&state, 5, &frames[0]);
            honest(&state, acts ? 1 : 0, &frames[1]);
            inputs.count = 2;
        } else if (state.pending.waits) {
            honest(&state, 2, &frames[0]);
            inputs.count = 1;
        }
        ctl_step(&state, &inputs, &outputs);
        starts[state.state == CTL_STATE_READY ? READY : ASSISTING] = state;
    }
    if (starts[READY].state != CTL_STATE_READY || starts[ASSISTING].state != CTL_STATE_ASSIST) {
        __builtin_trap();
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static ctl_state starts[STARTS];
    static bool prepared;
    ctl_state state;
    ctl_outputs outputs;
    ctl_frame frames[4];
    if (!prepared) {
        prepare(starts);
        prepared = true;
    }
    stream in = {data, size};
    ctl_inputs inputs = {.frames = frames};
    state = starts[take(&in, 1) % STARTS];
    inputs.now_ms = state.last_tick_ms;
    while (in.left > 0) {
        uint8_t how = (uint8_t)take(&in, 1);
        inputs.count = how % 5;
        any_readings(&in, &inputs);
        for (size_t at = 0; at < inputs.count; at++) {
            any_frame(&state, &in, &frames[at]);
        }
        unsigned repeat = how >= 252 ? 110 : how >= 230 ? 10 : 1;
        for (unsigned tick = 0; tick < repeat; tick++) {
            inputs.now_ms += how == 200 ? 7 : 1;
            ctl_step(&state, &inputs, &outputs);
            check(&state, &outputs);
            inputs.count = 0;
        }
    }
    return 0;
}
