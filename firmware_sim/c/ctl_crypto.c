/* AES-128 (FIPS 197), CMAC (RFC 4493), and what is authenticated with them (firmware_sim/secoc.py). */
#include <string.h>

#include "ctl_parts.h"

#define BLOCK 16U

static uint8_t *put_u32(uint8_t *to, uint32_t value) {
    to[0] = (uint8_t)(value >> 24);
    to[1] = (uint8_t)(value >> 16);
    to[2] = (uint8_t)(value >> 8);
    to[3] = (uint8_t)value;
    return to + 4;
}

#ifndef CTL_OWN_AES

/* What a byte of the state gives to a column of the next: twice, once, once and three times its substitute. */
#define DOUBLE(s) (((s) << 1 ^ ((s) >> 7) * 0x1BU) & 0xFFU)
#define T(s) (DOUBLE((uint32_t)(s)) << 24 | (uint32_t)(s) << 16 | (uint32_t)(s) << 8 | (DOUBLE((uint32_t)(s)) ^ (uint32_t)(s)))
static const uint32_t COLUMN[256] = {
    T(0x63), T(0x7c), T(0x77), T(0x7b), T(0xf2), T(0x6b), T(0x6f), T(0xc5), T(0x30), T(0x01), T(0x67), T(0x2b),
    T(0xfe), T(0xd7), T(0xab), T(0x76), T(0xca), T(0x82), T(0xc9), T(0x7d), T(0xfa), T(0x59), T(0x47), T(0xf0),
    T(0xad), T(0xd4), T(0xa2), T(0xaf), T(0x9c), T(0xa4), T(0x72), T(0xc0), T(0xb7), T(0xfd), T(0x93), T(0x26),
    T(0x36), T(0x3f), T(0xf7), T(0xcc), T(0x34), T(0xa5), T(0xe5), T(0xf1), T(0x71), T(0xd8), T(0x31), T(0x15),
    T(0x04), T(0xc7), T(0x23), T(0xc3), T(0x18), T(0x96), T(0x05), T(0x9a), T(0x07), T(0x12), T(0x80), T(0xe2),
    T(0xeb), T(0x27), T(0xb2), T(0x75), T(0x09), T(0x83), T(0x2c), T(0x1a), T(0x1b), T(0x6e), T(0x5a), T(0xa0),
    T(0x52), T(0x3b), T(0xd6), T(0xb3), T(0x29), T(0xe3), T(0x2f), T(0x84), T(0x53), T(0xd1), T(0x00), T(0xed),
    T(0x20), T(0xfc), T(0xb1), T(0x5b), T(0x6a), T(0xcb), T(0xbe), T(0x39), T(0x4a), T(0x4c), T(0x58), T(0xcf),
    T(0xd0), T(0xef), T(0xaa), T(0xfb), T(0x43), T(0x4d), T(0x33), T(0x85), T(0x45), T(0xf9), T(0x02), T(0x7f),
    T(0x50), T(0x3c), T(0x9f), T(0xa8), T(0x51), T(0xa3), T(0x40), T(0x8f), T(0x92), T(0x9d), T(0x38), T(0xf5),
    T(0xbc), T(0xb6), T(0xda), T(0x21), T(0x10), T(0xff), T(0xf3), T(0xd2), T(0xcd), T(0x0c), T(0x13), T(0xec),
    T(0x5f), T(0x97), T(0x44), T(0x17), T(0xc4), T(0xa7), T(0x7e), T(0x3d), T(0x64), T(0x5d), T(0x19), T(0x73),
    T(0x60), T(0x81), T(0x4f), T(0xdc), T(0x22), T(0x2a), T(0x90), T(0x88), T(0x46), T(0xee), T(0xb8), T(0x14),
    T(0xde), T(0x5e), T(0x0b), T(0xdb), T(0xe0), T(0x32), T(0x3a), T(0x0a), T(0x49), T(0x06), T(0x24), T(0x5c),
    T(0xc2), T(0xd3), T(0xac), T(0x62), T(0x91), T(0x95), T(0xe4), T(0x79), T(0xe7), T(0xc8), T(0x37), T(0x6d),
    T(0x8d), T(0xd5), T(0x4e), T(0xa9), T(0x6c), T(0x56), T(0xf4), T(0xea), T(0x65), T(0x7a), T(0xae), T(0x08),
    T(0xba), T(0x78), T(0x25), T(0x2e), T(0x1c), T(0xa6), T(0xb4), T(0xc6), T(0xe8), T(0xdd), T(0x74), T(0x1f),
    T(0x4b), T(0xbd), T(0x8b), T(0x8a), T(0x70), T(0x3e), T(0xb5), T(0x66), T(0x48), T(0x03), T(0xf6), T(0x0e),
    T(0x61), T(0x35), T(0x57), T(0xb9), T(0x86), T(0xc1), T(0x1d), T(0x9e), T(0xe1), T(0xf8), T(0x98), T(0x11),
    T(0x69), T(0xd9), T(0x8e), T(0x94), T(0x9b), T(0x1e), T(0x87), T(0xe9), T(0xce), T(0x55), T(0x28), T(0xdf),
    T(0x8c), T(0xa1), T(0x89), T(0x0d), T(0xbf), T(0xe6), T(0x42), T(0x68), T(0x41), T(0x99), T(0x2d), T(0x0f),
    T(0xb0), T(0x54), T(0xbb), T(0x16),
};

static uint32_t byte_of(uint32_t word, uint32_t shift) { return word >> shift & 0xFFU; }

static uint32_t turned(uint32_t word, uint32_t bits) { return word >> bits | word << (32U - bits); }

static uint32_t substitute(uint32_t byte) { return byte_of(COLUMN[byte], 8); }

static uint32_t word_at(const uint8_t *from) {
    return (uint32_t)from[0] << 24 | (uint32_t)from[1] << 16 | (uint32_t)from[2] << 8 | from[3];
}

/* The round key of the next round, in place. */
static inline void next_key(uint32_t key[4], uint32_t constant) {
    uint32_t last = key[3];
    key[0] ^= substitute(byte_of(last, 16)) << 24 | substitute(byte_of(last, 8)) << 16 |
              substitute(byte_of(last, 0)) << 8 | substitute(byte_of(last, 24));
    key[0] ^= constant << 24;
    key[1] ^= key[0];
    key[2] ^= key[1];
    key[3] ^= key[2];
}

/* One column of the next state, from the four that its rows come from: substituted, mixed. */
static inline uint32_t mixed(uint32_t first, uint32_t second, uint32_t third, uint32_t fourth) {
    return COLUMN[byte_of(first, 24)] ^ turned(COLUMN[byte_of(second, 16)], 8) ^
           turned(COLUMN[byte_of(third, 8)], 16) ^ turned(COLUMN[byte_of(fourth, 0)], 24);
}

/* The same in the last round, which does not mix. */
static inline uint32_t shifted(uint32_t first, uint32_t second, uint32_t third, uint32_t fourth) {
    return substitute(byte_of(first, 24)) << 24 | substitute(byte_of(second, 16)) << 16 |
           substitute(byte_of(third, 8)) << 8 | substitute(byte_of(fourth, 0));
}

/* Columns and round keys are written out, not looped over: they stay in registers, and a block takes half the time. */
void ctl_aes128(const uint8_t key[CTL_KEY_LENGTH], const uint8_t in[16], uint8_t out[16]) {
    uint32_t round_key[4] = {word_at(key), word_at(key + 4), word_at(key + 8), word_at(key + 12)};
    uint32_t a = word_at(in) ^ round_key[0], b = word_at(in + 4) ^ round_key[1];
    uint32_t c = word_at(in + 8) ^ round_key[2], d = word_at(in + 12) ^ round_key[3];
    uint32_t constant = 1;
    for (int round = 1; round < 10; round++) {
        next_key(round_key, constant);
        constant = DOUBLE(constant);
        uint32_t next_a = mixed(a, b, c, d) ^ round_key[0], next_b = mixed(b, c, d, a) ^ round_key[1];
        uint32_t next_c = mixed(c, d, a, b) ^ round_key[2];
        d = mixed(d, a, b, c) ^ round_key[3];
        a = next_a;
        b = next_b;
        c = next_c;
    }
    next_key(round_key, constant);
    out = put_u32(out, shifted(a, b, c, d) ^ round_key[0]);
    out = put_u32(out, shifted(b, c, d, a) ^ round_key[1]);
    out = put_u32(out, shifted(c, d, a, b) ^ round_key[2]);
    (void)put_u32(out, shifted(d, a, b, c) ^ round_key[3]);
}

#endif

static void subkey(uint8_t block[16]) {
    uint8_t carried = (uint8_t)(block[0] >> 7);
    for (size_t at = 0; at < BLOCK; at++) {
        uint8_t next = at < BLOCK - 1 ? block[at + 1] : 0;
        block[at] = (uint8_t)((uint32_t)block[at] << 1 | (uint32_t)(next >> 7));
    }
    block[BLOCK - 1] ^= (uint8_t)(carried * 0x87U);
}

void ctl_first_subkey(const uint8_t key[CTL_KEY_LENGTH], uint8_t first[16]) {
    memset(first, 0, BLOCK);
    ctl_aes128(key, first, first);
    subkey(first);
}

/* CMAC, where the key's first subkey is known. */
static void cmac_with(const uint8_t key[CTL_KEY_LENGTH], const uint8_t first[16], const uint8_t *message, size_t length,
                      uint8_t mac[16]) {
    uint8_t last[BLOCK];
    memcpy(last, first, BLOCK);
    memset(mac, 0, BLOCK);
    while (length > BLOCK) {
        for (size_t at = 0; at < BLOCK; at++) {
            mac[at] ^= message[at];
        }
        ctl_aes128(key, mac, mac);
        message += BLOCK;
        length -= BLOCK;
    }
    if (length < BLOCK) {
        subkey(last);
        last[length] ^= 0x80U;
    }
    for (size_t at = 0; at < length; at++) {
        last[at] ^= message[at];
    }
    for (size_t at = 0; at < BLOCK; at++) {
        mac[at] ^= last[at];
    }
    ctl_aes128(key, mac, mac);
}

void ctl_cmac(const uint8_t key[CTL_KEY_LENGTH], const uint8_t *message, size_t length, uint8_t mac[16]) {
    uint8_t first[BLOCK];
    ctl_first_subkey(key, first);
    cmac_with(key, first, message, length, mac);
}

static uint8_t *put_id(uint8_t *to, uint32_t can_id) {
    *to++ = (uint8_t)(can_id >> 8);
    *to++ = (uint8_t)can_id;
    return to;
}

static uint32_t truncated(const uint8_t mac[16]) {
    return (uint32_t)mac[0] << 24 | (uint32_t)mac[1] << 16 | (uint32_t)mac[2] << 8 | mac[3];
}

void ctl_session_key(const ctl_state *state, uint8_t key[CTL_KEY_LENGTH]) {
    uint8_t message[1 + sizeof ctl_session_label + 1 + 12 + 1 + 2] = {1};
    uint8_t *to = message + 1;
    memcpy(to, ctl_session_label, sizeof ctl_session_label);
    to += sizeof ctl_session_label + 1; /* and a byte of zero */
    to = put_u32(to, state->challenge.bridge_nonce);
    to = put_u32(to, state->challenge.device_nonce);
    to = put_u32(to, state->boot_nonce);
    *to = state->challenge.session;
    message[sizeof message - 1] = 0x80; /* bits of the key, 128 */
    ctl_cmac(state->shared_key, message, sizeof message, key);
}

uint32_t ctl_act_mac(const ctl_state *state, const uint8_t first[16], uint32_t freshness,
                     const uint8_t act_cmd[CTL_FRAME_LENGTH]) {
    uint8_t mac[BLOCK];
    uint8_t message[2 + 1 + 4 + CTL_FRAME_LENGTH];
    uint8_t *to = put_id(message, CTL_ACT_CMD);
    *to++ = state->session;
    to = put_u32(to, freshness);
    memcpy(to, act_cmd, CTL_FRAME_LENGTH);
    cmac_with(state->key, first, message, sizeof message, mac);
    return truncated(mac);
}

uint32_t ctl_arm_mac(const uint8_t key[CTL_KEY_LENGTH], const ctl_challenge *challenge) {
    uint8_t mac[BLOCK];
    uint8_t message[2 + 1 + 1 + 8];
    uint8_t *to = put_id(message, CTL_ARM_RESPONSE);
    *to++ = challenge->purpose;
    *to++ = challenge->session;
    to = put_u32(to, challenge->bridge_nonce);
    (void)put_u32(to, challenge->device_nonce);
    ctl_cmac(key, message, sizeof message, mac);
    return truncated(mac);
}

uint64_t ctl_whole_freshness(uint8_t low_byte, uint32_t last) {
    uint64_t candidate = (last & 0xFFFFFF00U) | low_byte;
    return candidate > last ? candidate : candidate + 0x100U;
}
