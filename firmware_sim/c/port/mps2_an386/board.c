/* Reference port: an ARM Cortex-M4 (MPS2, AN386) as QEMU emulates it. CAN is SLCAN on UART 0; the arm swings by itself;
 * a letter c on UART 1 is the hand at the device.
 *
 * It is for trying and testing. Its random numbers come from the times at which bytes arrive: on a board that a person
 * wears, take the chip's generator. Its key is the public one.
 */
#include <string.h>

#include "../port.h"
#include "../../ctl_parts.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define UART_DATA REGISTER(0x40004000U)
#define UART_STATE REGISTER(0x40004004U)
#define UART_CONTROL REGISTER(0x40004008U)
#define UART_CAME REGISTER(0x4000400CU)
#define UART_DIVIDER REGISTER(0x40004010U)
#define HAND_DATA REGISTER(0x40005000U)
#define HAND_STATE REGISTER(0x40005004U)
#define HAND_CONTROL REGISTER(0x40005008U)
#define HAND_DIVIDER REGISTER(0x40005010U)
#define SYSTICK_CONTROL REGISTER(0xE000E010U)
#define SYSTICK_RELOAD REGISTER(0xE000E014U)
#define SYSTICK_VALUE REGISTER(0xE000E018U)
#define INTERRUPTS REGISTER(0xE000E100U)
#define CLOCK_HZ 25000000U
#ifndef BOARD_KEY
#define BOARD_KEY "hilbridge-demo-k" /* 16 letters */
#endif
#define LINE 32U /* the longest: T, 8 of identifier, length, 16 of data */

static volatile uint32_t milliseconds;
static uint32_t chance = 0x9E3779B9U;
static char line[LINE];
static size_t filled;
static bool is_open;
static uint8_t queued_count;
static ctl_frame queued[16];
#ifdef BOARD_LAB
/* Milliseconds that the laboratory has granted: after the first, time goes by only so. A frame that is sent ends a grant. */
static uint32_t granted, used;
static bool is_granted;
#endif

void SysTick_Handler(void);
void Uart_Handler(void);
void Reset_Handler(void);

void SysTick_Handler(void) { milliseconds = milliseconds + 1; }

/* A byte has come: reason enough to wake. */
void Uart_Handler(void) { UART_CAME = 2; }

/* Sleep until a byte or a millisecond comes; one that has come since `seen` is none to sleep over. */
static void rest(uint32_t seen) {
    __asm volatile("cpsid i");
    if ((UART_STATE & 2U) == 0 && milliseconds == seen) {
        __asm volatile("wfi");
    }
    __asm volatile("cpsie i");
}

uint32_t port_random(void) {
    chance ^= SYSTICK_VALUE;
    chance ^= chance << 13;
    chance ^= chance >> 17;
    chance ^= chance << 5;
    return chance;
}

/* A hexadecimal digit; 16 for what is none. */
static uint32_t digit(char letter) {
    if (letter >= '0' && letter <= '9') {
        return (uint32_t)(letter - '0');
    }
    if (letter >= 'A' && letter <= 'F') {
        return (uint32_t)(letter - 'A' + 10);
    }
    return letter >= 'a' && letter <= 'f' ? (uint32_t)(letter - 'a' + 10) : 16U;
}

static bool number(size_t from, size_t digits, uint32_t *value) {
    *value = 0;
    for (size_t at = from; at < from + digits; at++) {
        uint32_t next = at < filled ? digit(line[at]) : 16U;
        if (next > 15) {
            return false;
        }
        *value = *value << 4 | next;
    }
    return true;
}

/* A line of SLCAN: t and T are data frames, r and R remote ones; O and C open and close the channel. */
static void take_line(void) {
    bool extended = line[0] == 'T' || line[0] == 'R';
    bool remote = line[0] == 'r' || line[0] == 'R';
    size_t digits = extended ? 8 : 3;
    uint32_t length = 0;
    ctl_frame *frame = &queued[queued_count];
    if (line[0] == 'O' || line[0] == 'C') {
        is_open = line[0] == 'O';
        return;
    }
#ifdef BOARD_LAB
    if (line[0] == 'g') {
        is_granted = number(1, 4, &granted);
        return;
    }
#endif
    if (!is_open || !(extended || remote || line[0] == 't') || !number(1, digits, &frame->can_id) ||
        !number(1 + digits, 1, &length) || length > CTL_FRAME_LENGTH) {
        return;
    }
    frame->plain = !extended && !remote;
    frame->length = (uint8_t)length;
    memset(frame->data, 0, CTL_FRAME_LENGTH);
    for (uint32_t at = 0; at < length && !remote; at++) {
        uint32_t byte;
        if (!number(2 + digits + 2 * at, 2, &byte)) {
            return;
        }
        frame->data[at] = (uint8_t)byte;
    }
    queued_count++;
}

static void listen(void) {
    while ((UART_STATE & 2U) != 0 && queued_count < sizeof queued / sizeof queued[0]) {
        char letter = (char)UART_DATA;
        (void)port_random();
        if (letter == '\r') {
            if (filled > 0) {
                take_line();
            }
            filled = 0;
        } else if (filled < LINE) {
            line[filled++] = letter;
        }
    }
}

bool port_receive(ctl_frame *frame) {
    if (queued_count == 0) {
        return false;
    }
    *frame = queued[0];
    queued_count--;
    memmove(queued, queued + 1, queued_count * sizeof queued[0]);
    return true;
}

static void put(char letter) {
    while ((UART_STATE & 1U) != 0) {
    }
    UART_DATA = (uint32_t)letter;
}

static void put_hex(uint32_t value, int digits) {
    while (digits-- > 0) {
        put("0123456789ABCDEF"[value >> (4 * digits) & 15U]);
    }
}

bool port_send(const ctl_sent *frame) {
#ifdef BOARD_LAB
    granted = 0;
#endif
    if (!is_open) {
        return false;
    }
    put('t');
    put_hex(frame->can_id, 3);
    put_hex(CTL_FRAME_LENGTH, 1);
    for (size_t at = 0; at < CTL_FRAME_LENGTH; at++) {
        put_hex(frame->data[at], 2);
    }
    put('\r');
    return true;
}

int64_t port_tick(void) {
    static uint32_t seen;
#ifdef BOARD_LAB
    if (is_granted) {
        if (granted == 0) {
            put('G'); /* so many have gone by */
            put_hex(used, 4);
            put('\r');
            used = 0;
        }
        while (granted == 0) {
            rest(milliseconds);
            listen();
        }
        granted--;
        used++;
        seen++;
        return seen;
    }
#endif
    while (milliseconds == seen) {
        listen();
        rest(seen);
    }
    listen();
    seen++; /* one tick after the other, also where the emulator was late */
    return seen;
}

/* An arm that swings slowly between 40 and 100 degrees, with a tremor of 6 Hz upon it; a motor that does as it is told. */
void port_joint(int64_t torque_unm, ctl_inputs *inputs) {
    static int32_t angle_udeg = 60000000, slow_mdeg_s = 20000, phase;
    phase = (phase + 1) % 168;
    if (angle_udeg > 100000000 || angle_udeg < 40000000) {
        slow_mdeg_s = angle_udeg < 40000000 ? 20000 : -20000;
    }
    inputs->velocity_mdeg_s = slow_mdeg_s + 190 * (phase < 84 ? phase - 42 : 126 - phase);
    angle_udeg += inputs->velocity_mdeg_s;
    inputs->angle_mdeg = angle_udeg / 1000;
    inputs->second_angle_mdeg = inputs->angle_mdeg;
    inputs->measured_unm = (int32_t)torque_unm;
    inputs->commanded_unm = (int32_t)torque_unm;
    inputs->self_test_ok = true;
    inputs->local_clear = (HAND_STATE & 2U) != 0 && HAND_DATA == 'c';
}

static void start(void) {
    static const uint8_t key[CTL_KEY_LENGTH + 1] = BOARD_KEY;
    UART_DIVIDER = 16;
    UART_CONTROL = 11; /* sends, receives, and tells of each byte */
    INTERRUPTS = 1;
    HAND_DIVIDER = 16;
    HAND_CONTROL = 3;
    SYSTICK_RELOAD = CLOCK_HZ / 1000 - 1;
    SYSTICK_VALUE = 0;
    SYSTICK_CONTROL = 7;
    while (!is_open) { /* what arrives until then is all the chance there is */
        listen();
    }
    port_run(key, &ctl_default_limits);
}

extern uint32_t data_from[], data_start[], data_end[], bss_start[], bss_end[], stack_top[];

void Reset_Handler(void) {
    memcpy(data_start, data_from, (size_t)((char *)data_end - (char *)data_start));
    memset(bss_start, 0, (size_t)((char *)bss_end - (char *)bss_start));
    start();
}

static void stop(void) {
    for (;;) { /* a fault: silence, which a bridge sees within 60 ms */
    }
}

typedef union {
    void *top;
    void (*handler)(void);
} vector;

__attribute__((section(".vectors"), used)) static const vector vectors[17] = {
    {.top = stack_top}, {.handler = Reset_Handler}, {.handler = stop}, {.handler = stop}, {.handler = stop},
    {.handler = stop},  {.handler = stop},          {.handler = stop}, {.handler = stop}, {.handler = stop},
    {.handler = stop},  {.handler = stop},          {.handler = stop}, {.handler = stop}, {.handler = stop},
    {.handler = SysTick_Handler},
    {.handler = Uart_Handler},
};
