/* Frames: E2E profile 5 with its state machine (e2e.py), bit codec (frames.py), transmission (transmit.py). */
#include <string.h>

#include "ctl_parts.h"

uint16_t ctl_crc16(const uint8_t *data, size_t length, uint16_t start) {
    uint16_t crc = start;
    for (size_t at = 0; at < length; at++) {
        crc = (uint16_t)((uint32_t)crc << 8 ^ ctl_crc_table[crc >> 8 ^ data[at]]);
    }
    return crc;
}

static uint16_t frame_crc(const ctl_message *message, const uint8_t data[CTL_FRAME_LENGTH]) {
    const uint8_t tail[2] = {(uint8_t)message->data_id, (uint8_t)(message->data_id >> 8)};
    return ctl_crc16(tail, sizeof tail, ctl_crc16(data + 2, CTL_FRAME_LENGTH - 2, 0xFFFF));
}

static int count_of(const ctl_receiver *receiver, uint8_t result) {
    int found = 0;
    for (uint8_t at = 0; at < receiver->filled; at++) {
        found += receiver->window[at] == result;
    }
    return found;
}

static void remember_check(ctl_receiver *receiver, uint8_t result) {
    if (receiver->filled == CTL_WINDOW) {
        memmove(receiver->window, receiver->window + 1, CTL_WINDOW - 1);
        receiver->filled--;
    }
    receiver->window[receiver->filled] = result;
    receiver->filled++;
}

/* One step of the E2E state machine. */
static void advance(ctl_receiver *receiver, uint8_t result) {
    if (receiver->machine == CTL_MACHINE_NO_DATA) {
        if (result != CTL_CHECK_ERROR) {
            receiver->machine = CTL_MACHINE_INIT;
            receiver->filled = 0;
            remember_check(receiver, result);
        }
        return;
    }
    remember_check(receiver, result);
    int good = count_of(receiver, CTL_CHECK_OK) + count_of(receiver, CTL_CHECK_OK_SOME_LOST);
    int errors = count_of(receiver, CTL_CHECK_ERROR);
    if (receiver->machine == CTL_MACHINE_INIT) {
        if (errors > CTL_MAX_ERROR_INIT) {
            receiver->machine = CTL_MACHINE_INVALID;
        } else if (good >= CTL_MIN_OK_INIT) {
            receiver->machine = CTL_MACHINE_VALID;
        }
    } else if (receiver->machine == CTL_MACHINE_VALID) {
        if (errors > CTL_MAX_ERROR_VALID || good < CTL_MIN_OK_VALID) {
            receiver->machine = CTL_MACHINE_INVALID;
        }
    } else if (errors <= CTL_MAX_ERROR_INVALID && good >= CTL_MIN_OK_INVALID) {
        receiver->machine = CTL_MACHINE_VALID;
    }
}

uint8_t ctl_e2e_check(uint32_t slot, const uint8_t data[CTL_FRAME_LENGTH], ctl_receiver *receiver) {
    const ctl_message *message = &ctl_received[slot];
    uint8_t result = CTL_CHECK_OK;
    if (frame_crc(message, data) != (uint16_t)(data[0] | (uint32_t)data[1] << 8)) {
        advance(receiver, CTL_CHECK_ERROR);
        return CTL_CHECK_ERROR;
    }
    if (receiver->seen) {
        uint8_t delta = (uint8_t)(data[2] - receiver->counter);
        if (delta == 0) {
            result = CTL_CHECK_REPEATED;
        } else if (delta > message->max_delta) {
            result = CTL_CHECK_WRONG_SEQUENCE;
        } else if (delta > 1) {
            result = CTL_CHECK_OK_SOME_LOST;
            receiver->lost += delta - 1U;
        }
    }
    receiver->seen = true;
    receiver->counter = data[2];
    advance(receiver, result);
    return result;
}

void ctl_e2e_overdue(ctl_receiver *receiver) {
    if (receiver->machine != CTL_MACHINE_NO_DATA) {
        receiver->machine = CTL_MACHINE_INVALID;
        receiver->filled = CTL_WINDOW;
        memset(receiver->window, CTL_CHECK_NO_NEW_DATA, CTL_WINDOW);
    }
}

static uint32_t mask_of(const ctl_field *field) { return (uint32_t)((1ULL << field->bits) - 1U); }

/* Raw values in the order of the message's fields, or why it is none. No field that the device receives has a sign. */
uint8_t ctl_unpack(uint32_t slot, const uint8_t data[CTL_FRAME_LENGTH], uint32_t values[CTL_MOST_FIELDS]) {
    const ctl_message *message = &ctl_received[slot];
    uint64_t word = 0;
    for (size_t at = CTL_FRAME_LENGTH; at > 0; at--) {
        word = word << 8 | data[at - 1];
    }
    if ((word & message->reserved) != 0) {
        return CTL_REJECT_RESERVED;
    }
    for (size_t at = 0; at < message->field_count; at++) {
        const ctl_field *field = &message->fields[at];
        uint32_t value = (uint32_t)(word >> field->start) & mask_of(field);
        if (field->enumerated && (value > 31 || (field->allowed >> value & 1U) == 0)) {
            return CTL_REJECT_ENUM;
        }
        if (value < field->lowest || value > field->highest) {
            return field->multiplexer ? CTL_REJECT_MUX : CTL_REJECT_RANGE;
        }
        values[at] = value;
    }
    return CTL_REJECT_ACCEPTED;
}

/* Counters stop at 32 bits and never wrap. */
void ctl_count(ctl_state *state, uint32_t index, uint64_t amount) {
    uint64_t room = UINT32_MAX - state->counters[index];
    state->counters[index] += (uint32_t)(amount < room ? amount : room);
}

/* Put a protected frame into the outbox; what does not fit is dropped and counted. Its E2E counter. */
uint8_t ctl_send(ctl_state *state, uint32_t slot, const int64_t values[CTL_MOST_FIELDS]) {
    const ctl_message *message = &ctl_own[slot];
    uint8_t counter = ++state->tx_counters[slot];
    if (state->outbox_count == CTL_OUTBOX_SLOTS) {
        ctl_count(state, CTL_COUNT_TX_DROPPED, 1);
        return counter;
    }
    ctl_sent *sent = &state->outbox[state->outbox_count++];
    uint64_t word = (uint64_t)counter << 16;
    for (size_t at = 0; at < message->field_count; at++) {
        const ctl_field *field = &message->fields[at];
        word |= ((uint64_t)values[at] & mask_of(field)) << field->start;
    }
    for (size_t at = 0; at < CTL_FRAME_LENGTH; at++) {
        sent->data[at] = (uint8_t)(word >> (8 * at));
    }
    uint16_t crc = frame_crc(message, sent->data);
    sent->can_id = message->can_id;
    sent->data[0] = (uint8_t)crc;
    sent->data[1] = (uint8_t)(crc >> 8);
    return counter;
}

void ctl_emergency(ctl_state *state, uint8_t reason) {
    bool latched = state->state == CTL_STATE_LATCHED || state->state == CTL_STATE_ESTOP;
    state->emergencies++;
    const int64_t values[CTL_MOST_FIELDS] = {reason, state->state, latched, state->emergencies & 0xFFU};
    (void)ctl_send(state, CTL_SLOT_CTRL_EMCY, values);
}

/* The bridge has to echo this frame's counter, so the time of sending is remembered. */
static void send_status(ctl_state *state, int64_t now_ms) {
    bool assisting = state->state == CTL_STATE_ASSIST;
    const int64_t values[CTL_MOST_FIELDS] = {
        state->state,
        state->reason,
        assisting ? state->verb : CTL_VERB_NONE,
        assisting ? ctl_max(0, state->torque.authority) / 10 : 0,
        state->accepted_counter,
        state->session,
        state->armed,
        state->torque.assist_unm == 0,
    };
    if (state->echo_count == CTL_ECHO_SLOTS) {
        memmove(state->echoes, state->echoes + 1, sizeof state->echoes - sizeof state->echoes[0]);
        state->echo_count--;
    }
    uint8_t counter = ctl_send(state, CTL_SLOT_CTRL_STATUS, values);
    state->echoes[state->echo_count].counter = counter;
    state->echoes[state->echo_count].sent_ms = now_ms;
    state->echo_count++;
    state->status_due_ms = now_ms + CTL_STATUS_CYCLE_MS;
}

static void send_measurement(ctl_state *state, const ctl_inputs *inputs) {
    const int64_t values[CTL_MOST_FIELDS] = {
        0,
        ctl_min(ctl_max(((int64_t)inputs->angle_mdeg + CTL_ANGLE_OFFSET_MDEG) / 250, 0), 1023),
        ctl_clamp((int64_t)inputs->velocity_mdeg_s / 2000, 511),
        ctl_clamp(state->torque.assist_unm / 20000, 127),
        ctl_clamp(state->torque.gravity_unm / 50000, 127),
    };
    (void)ctl_send(state, CTL_SLOT_CTRL_MEAS, values);
}

void ctl_send_cyclic(ctl_state *state, const ctl_inputs *inputs, bool changed) {
    int64_t now_ms = inputs->now_ms;
    if (changed || now_ms >= state->status_due_ms) {
        send_status(state, now_ms);
    }
    if (now_ms >= state->meas_due_ms) {
        send_measurement(state, inputs);
        state->meas_due_ms = now_ms + CTL_MEAS_CYCLE_MS;
    }
    if (now_ms >= state->heartbeat_due_ms) {
        const int64_t values[CTL_MOST_FIELDS] = {CTL_PROTOCOL_VERSION, state->boot_nonce};
        (void)ctl_send(state, CTL_SLOT_CTRL_HB, values);
        state->heartbeat_due_ms = now_ms + CTL_HEARTBEAT_CYCLE_MS;
    }
    if (now_ms >= state->diag_due_ms) {
        const int64_t values[CTL_MOST_FIELDS] = {state->diag_index, state->counters[state->diag_index]};
        (void)ctl_send(state, CTL_SLOT_CTRL_DIAG, values);
        state->diag_index = (uint8_t)((state->diag_index + 1) % CTL_COUNTERS);
        state->diag_due_ms = now_ms + CTL_DIAG_CYCLE_MS;
    }
}
