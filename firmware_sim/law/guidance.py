"""Guidance: a small push along with the wearer's own movement. Never before their onset, never against their direction."""

from __future__ import annotations

from firmware_sim.law.memory import Torque
from firmware_sim.law.numbers import REACHED, clamp
from firmware_sim.profiles import Guidance, Profile

ONSET_MDEG_S = 8_000
ONSET_TICKS = 200  # longer than half a period of 3.5 Hz, its first swing included: tremor is no onset (H6)
CONTACT_MDEG_S = 3_000
CONTACT_TICKS = 40
REACH_MDEG = 35_000
REACH_TICKS = 900
NEAR_MDEG = 8_000
GUIDE_STIFFNESS = 60  # uN m per mdeg
GUIDE_UNM = 50_000
GUIDE_RATE_UNM_PER_MS = 500


def onset(torque: Torque) -> None:
    """Counts how long the voluntary velocity has kept one direction above the onset speed."""
    slow = torque.slow_mean >> 10
    direction = 0 if abs(slow) < ONSET_MDEG_S else (1 if slow > 0 else -1)
    if direction == 0 or direction != torque.direction:
        torque.direction = direction
        torque.onset_ticks = 0
    else:
        torque.onset_ticks += 1


def near_target(torque: Torque, angle_mdeg: int) -> bool:
    """The end of the guided reach is close."""
    target = torque.guide_from_mdeg + torque.direction * REACH_MDEG
    return torque.guide_tick > 0 and abs(target - angle_mdeg) < NEAR_MDEG


def _push(torque: Torque, profile: Profile, angle_mdeg: int) -> int:
    if torque.guide_tick == 0:
        if torque.onset_ticks < ONSET_TICKS or profile.guidance is Guidance.NEVER:
            return 0
        torque.guide_tick = 1
        torque.guide_from_mdeg = angle_mdeg
        torque.contact_ticks = 0
        torque.fade_ticks = 0
    direction = torque.direction
    if profile.guidance is Guidance.MINIMUM_JERK:
        if direction == 0:
            torque.guide_tick = 0
            return 0
        reached = REACHED[min(torque.guide_tick * 100 // REACH_TICKS, 100)]
        wanted = torque.guide_from_mdeg + direction * REACH_MDEG * reached // 1000
        push = clamp(GUIDE_STIFFNESS * (wanted - angle_mdeg), GUIDE_UNM)
        over = torque.guide_tick > REACH_TICKS
    else:
        slow = abs(torque.slow_mean >> 10) < CONTACT_MDEG_S
        torque.contact_ticks = torque.contact_ticks + 1 if slow else 0
        push = GUIDE_UNM * direction
        over = torque.contact_ticks >= CONTACT_TICKS
    torque.guide_tick += 1
    if push * direction <= 0:
        push = 0
    if over or torque.fade_ticks:
        push = push * max(0, profile.ramp_out_ms - torque.fade_ticks) // profile.ramp_out_ms
        torque.fade_ticks += 1
        if torque.fade_ticks > profile.ramp_out_ms:
            torque.guide_tick = 0
            torque.fade_ticks = 0
            torque.onset_ticks = 0
    return push


def guide(torque: Torque, profile: Profile, angle_mdeg: int, scale: int) -> None:
    """One tick of guidance, scaled (per mille), at its own gentle rate."""
    push = _push(torque, profile, angle_mdeg) * scale // 1000
    torque.guide_unm += clamp(push - torque.guide_unm, GUIDE_RATE_UNM_PER_MS)
