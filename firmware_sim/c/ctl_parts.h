/* What the parts of the controller offer each other. */
#ifndef CTL_PARTS_H
#define CTL_PARTS_H

#include "ctl.h"

/* ctl_crypto.c. A chip's own engine takes the place of ctl_aes128 at link time: define CTL_OWN_AES and write it. */
void ctl_aes128(const uint8_t key[CTL_KEY_LENGTH], const uint8_t in[16], uint8_t out[16]);
void ctl_cmac(const uint8_t key[CTL_KEY_LENGTH], const uint8_t *message, size_t length, uint8_t mac[16]);
void ctl_session_key(const ctl_state *state, uint8_t key[CTL_KEY_LENGTH]);
/* `first` is the session key's first subkey: the same for all commands that one ACT_AUTH may be for. */
void ctl_first_subkey(const uint8_t key[CTL_KEY_LENGTH], uint8_t first[16]);
uint32_t ctl_act_mac(const ctl_state *state, const uint8_t first[16], uint32_t freshness,
                     const uint8_t act_cmd[CTL_FRAME_LENGTH]);
uint32_t ctl_arm_mac(const uint8_t key[CTL_KEY_LENGTH], const ctl_challenge *challenge);
uint64_t ctl_whole_freshness(uint8_t low_byte, uint32_t last);

/* ctl_wire.c */
uint16_t ctl_crc16(const uint8_t *data, size_t length, uint16_t start);
uint8_t ctl_e2e_check(uint32_t slot, const uint8_t data[CTL_FRAME_LENGTH], ctl_receiver *receiver);
void ctl_e2e_overdue(ctl_receiver *receiver);
uint8_t ctl_unpack(uint32_t slot, const uint8_t data[CTL_FRAME_LENGTH], uint32_t values[CTL_MOST_FIELDS]);
uint8_t ctl_send(ctl_state *state, uint32_t slot, const int64_t values[CTL_MOST_FIELDS]);
void ctl_emergency(ctl_state *state, uint8_t reason);
void ctl_send_cyclic(ctl_state *state, const ctl_inputs *inputs, bool changed);
void ctl_count(ctl_state *state, uint32_t index, uint64_t amount);
static inline void ctl_reject(ctl_state *state, uint8_t why) { ctl_count(state, why, 1); }

/* ctl_transitions.c */
void ctl_fire(ctl_state *state, uint8_t event, uint8_t reason, int64_t now_ms);
void ctl_disarm(ctl_state *state);
void ctl_trip(ctl_state *state, uint8_t reason, int64_t now_ms);
void ctl_mac_failed(ctl_state *state, int64_t now_ms);
void ctl_bus_off(ctl_state *state, int64_t now_ms);
void ctl_command_overdue(ctl_state *state, int64_t now_ms);
bool ctl_fresh(int64_t stamp_ms, int64_t now_ms, int64_t limit_ms);

/* ctl_receive.c */
void ctl_receive(ctl_state *state, const ctl_frame *frame, uint32_t random_u32, int64_t now_ms);
void ctl_authorisation_missing(ctl_state *state, int64_t now_ms);

/* ctl_handshake.c */
void ctl_asked(ctl_state *state, const uint8_t data[CTL_FRAME_LENGTH]);
void ctl_arm_request(ctl_state *state, const uint32_t *values, uint32_t random_u32, int64_t now_ms);
void ctl_arm_response(ctl_state *state, const uint32_t *values, int64_t now_ms);

/* ctl_law.c, ctl_damping.c */
void ctl_track(ctl_torque *torque, int64_t velocity_mdeg_s, int64_t user_unm);
void ctl_assisting(ctl_torque *torque, const ctl_profile *profile, int64_t angle_mdeg, int64_t velocity_mdeg_s);
void ctl_ramping(ctl_torque *torque, int64_t stride, int64_t velocity_mdeg_s);
void ctl_letting_go(ctl_torque *torque, int64_t velocity_mdeg_s);
void ctl_at_rest(ctl_torque *torque);
void ctl_support_gone(ctl_torque *torque);
int64_t ctl_follow_torque(int64_t angle_mdeg, int64_t velocity_mdeg_s);
int64_t ctl_wanted(const ctl_torque *torque, const ctl_profile *profile, int64_t velocity_mdeg_s, bool near);
void ctl_damp(ctl_torque *torque, int64_t size, int64_t room, int64_t velocity_mdeg_s);
void ctl_damp_less(ctl_torque *torque, int64_t velocity_mdeg_s);

/* Arithmetic. C divides towards zero; where the reference rounds down, so do these. */
static inline int64_t ctl_min(int64_t a, int64_t b) { return a < b ? a : b; }
static inline int64_t ctl_max(int64_t a, int64_t b) { return a > b ? a : b; }
static inline int64_t ctl_abs(int64_t a) { return a < 0 ? -a : a; }
static inline int64_t ctl_clamp(int64_t value, int64_t limit) { return ctl_max(-limit, ctl_min(limit, value)); }
static inline int64_t ctl_floor_div(int64_t a, int64_t b) { return a >= 0 ? a / b : -((-a + b - 1) / b); }
static inline int64_t ctl_floor_shift(int64_t a, int bits) { return a >= 0 ? a >> bits : ~(~a >> bits); }

#endif
