/* AES-128 (FIPS 197), CMAC (RFC 4493), and what is authenticated with them (firmware_sim/secoc.py). */
#include <string.h>

#include "ctl_parts.h"

#define BLOCK 16U

#ifndef CTL_OWN_AES

static const uint8_t SBOX[256] = {
    0x63, 0x7c, 0x77, 0x7b, 0xf2, 0x6b, 0x6f, 0xc5, 0x30, 0x01, 0x67, 0x2b, 0xfe, 0xd7, 0xab, 0x76,
    0xca, 0x82, 0xc9, 0x7d, 0xfa, 0x59, 0x47, 0xf0, 0xad, 0xd4, 0xa2, 0xaf, 0x9c, 0xa4, 0x72, 0xc0,
    0xb7, 0xfd, 0x93, 0x26, 0x36, 0x3f, 0xf7, 0xcc, 0x34, 0xa5, 0xe5, 0xf1, 0x71, 0xd8, 0x31, 0x15,
    0x04, 0xc7, 0x23, 0xc3, 0x18, 0x96, 0x05, 0x9a, 0x07, 0x12, 0x80, 0xe2, 0xeb, 0x27, 0xb2, 0x75,
    0x09, 0x83, 0x2c, 0x1a, 0x1b, 0x6e, 0x5a, 0xa0, 0x52, 0x3b, 0xd6, 0xb3, 0x29, 0xe3, 0x2f, 0x84,
    0x53, 0xd1, 0x00, 0xed, 0x20, 0xfc, 0xb1, 0x5b, 0x6a, 0xcb, 0xbe, 0x39, 0x4a, 0x4c, 0x58, 0xcf,
    0xd0, 0xef, 0xaa, 0xfb, 0x43, 0x4d, 0x33, 0x85, 0x45, 0xf9, 0x02, 0x7f, 0x50, 0x3c, 0x9f, 0xa8,
    0x51, 0xa3, 0x40, 0x8f, 0x92, 0x9d, 0x38, 0xf5, 0xbc, 0xb6, 0xda, 0x21, 0x10, 0xff, 0xf3, 0xd2,
    0xcd, 0x0c, 0x13, 0xec, 0x5f, 0x97, 0x44, 0x17, 0xc4, 0xa7, 0x7e, 0x3d, 0x64, 0x5d, 0x19, 0x73,
    0x60, 0x81, 0x4f, 0xdc, 0x22, 0x2a, 0x90, 0x88, 0x46, 0xee, 0xb8, 0x14, 0xde, 0x5e, 0x0b, 0xdb,
    0xe0, 0x32, 0x3a, 0x0a, 0x49, 0x06, 0x24, 0x5c, 0xc2, 0xd3, 0xac, 0x62, 0x91, 0x95, 0xe4, 0x79,
    0xe7, 0xc8, 0x37, 0x6d, 0x8d, 0xd5, 0x4e, 0xa9, 0x6c, 0x56, 0xf4, 0xea, 0x65, 0x7a, 0xae, 0x08,
    0xba, 0x78, 0x25, 0x2e, 0x1c, 0xa6, 0xb4, 0xc6, 0xe8, 0xdd, 0x74, 0x1f, 0x4b, 0xbd, 0x8b, 0x8a,
    0x70, 0x3e, 0xb5, 0x66, 0x48, 0x03, 0xf6, 0x0e, 0x61, 0x35, 0x57, 0xb9, 0x86, 0xc1, 0x1d, 0x9e,
    0xe1, 0xf8, 0x98, 0x11, 0x69, 0xd9, 0x8e, 0x94, 0x9b, 0x1e, 0x87, 0xe9, 0xce, 0x55, 0x28, 0xdf,
    0x8c, 0xa1, 0x89, 0x0d, 0xbf, 0xe6, 0x42, 0x68, 0x41, 0x99, 0x2d, 0x0f, 0xb0, 0x54, 0xbb, 0x16,
};

static uint8_t doubled(uint8_t byte) { return (uint8_t)((uint32_t)byte << 1 ^ (uint32_t)(byte >> 7) * 0x1BU); }

static void add_key(uint8_t block[16], const uint8_t key[16]) {
    for (size_t at = 0; at < BLOCK; at++) {
        block[at] ^= key[at];
    }
}

/* The round key of the next round, in place. */
static void next_key(uint8_t key[16], uint8_t constant) {
    key[0] ^= (uint8_t)(SBOX[key[13]] ^ constant);
    key[1] ^= SBOX[key[14]];
    key[2] ^= SBOX[key[15]];
    key[3] ^= SBOX[key[12]];
    for (size_t at = 4; at < BLOCK; at++) {
        key[at] ^= key[at - 4];
    }
}

static void substitute_and_shift(uint8_t block[16]) {
    uint8_t old[BLOCK];
    memcpy(old, block, BLOCK);
    for (size_t at = 0; at < BLOCK; at++) {
        block[at] = SBOX[old[(at + 4 * (at % 4)) % BLOCK]];
    }
}

static void mix(uint8_t block[16]) {
    for (uint8_t *column = block; column < block + BLOCK; column += 4) {
        uint8_t first = column[0];
        uint8_t all = (uint8_t)(column[0] ^ column[1] ^ column[2] ^ column[3]);
        for (size_t row = 0; row < 4; row++) {
            uint8_t next = row < 3 ? column[row + 1] : first;
            column[row] = (uint8_t)(column[row] ^ all ^ doubled((uint8_t)(column[row] ^ next)));
        }
    }
}

void ctl_aes128(const uint8_t key[CTL_KEY_LENGTH], const uint8_t in[16], uint8_t out[16]) {
    uint8_t round_key[BLOCK];
    uint8_t constant = 1;
    memcpy(round_key, key, BLOCK);
    memmove(out, in, BLOCK);
    add_key(out, round_key);
    for (int round = 1; round <= 10; round++) {
        substitute_and_shift(out);
        if (round < 10) {
            mix(out);
        }
        next_key(round_key, constant);
        constant = doubled(constant);
        add_key(out, round_key);
    }
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

void ctl_cmac(const uint8_t key[CTL_KEY_LENGTH], const uint8_t *message, size_t length, uint8_t mac[16]) {
    uint8_t last[BLOCK] = {0};
    memset(mac, 0, BLOCK);
    ctl_aes128(key, last, last);
    subkey(last);
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

static uint8_t *put_u32(uint8_t *to, uint32_t value) {
    for (int shift = 24; shift >= 0; shift -= 8) {
        *to++ = (uint8_t)(value >> shift);
    }
    return to;
}

static uint8_t *put_id(uint8_t *to, uint32_t can_id) {
    *to++ = (uint8_t)(can_id >> 8);
    *to++ = (uint8_t)can_id;
    return to;
}

static uint32_t truncated(const uint8_t key[CTL_KEY_LENGTH], const uint8_t *message, size_t length) {
    uint8_t mac[BLOCK];
    ctl_cmac(key, message, length, mac);
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

uint32_t ctl_act_mac(const ctl_state *state, uint32_t freshness, const uint8_t act_cmd[CTL_FRAME_LENGTH]) {
    uint8_t message[2 + 1 + 4 + CTL_FRAME_LENGTH];
    uint8_t *to = put_id(message, CTL_ACT_CMD);
    *to++ = state->session;
    to = put_u32(to, freshness);
    memcpy(to, act_cmd, CTL_FRAME_LENGTH);
    return truncated(state->key, message, sizeof message);
}

uint32_t ctl_arm_mac(const uint8_t key[CTL_KEY_LENGTH], const ctl_challenge *challenge) {
    uint8_t message[2 + 1 + 1 + 8];
    uint8_t *to = put_id(message, CTL_ARM_RESPONSE);
    *to++ = challenge->purpose;
    *to++ = challenge->session;
    to = put_u32(to, challenge->bridge_nonce);
    (void)put_u32(to, challenge->device_nonce);
    return truncated(key, message, sizeof message);
}

uint64_t ctl_whole_freshness(uint8_t low_byte, uint32_t last) {
    uint64_t candidate = (last & 0xFFFFFF00U) | low_byte;
    return candidate > last ? candidate : candidate + 0x100U;
}
