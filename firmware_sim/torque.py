"""The 1 kHz torque law. Assist (damping, guidance) and gravity support of the wearer's arm are kept apart everywhere.

Integers throughout: torque uN m, angle mdeg (0 hangs down, 90000 is level), velocity mdeg/s, one call per millisecond,
which changes the law's memory in place. Only `assisting` can raise assist; everything else in this module can only lower
it. Its parts are in firmware_sim/law.
"""

from __future__ import annotations

from firmware_sim.law import allowance, damping, guidance
from firmware_sim.law.memory import Torque
from firmware_sim.law.numbers import RAMP_TICKS, REMAINING, WAY_TICKS, clamp, div, sine_per_mille
from firmware_sim.law.support import support, support_gone, support_less
from firmware_sim.profiles import Profile

STOP_STRIDE = 4  # the ramp table at four times the pace: zero in 10 ms
DEVICE_WEIGHT_UNM = 800_000  # the device's own link held level


def follow_torque(angle_mdeg: int, velocity_mdeg_s: int) -> int:
    """Follow mode: cancels the device's own weight and most of its friction. Neither assist nor gravity support."""
    return DEVICE_WEIGHT_UNM * sine_per_mille(angle_mdeg) // 1000 + div(velocity_mdeg_s * 14, 10)


def assisting(torque: Torque, profile: Profile, angle_mdeg: int, velocity_mdeg_s: int) -> None:
    """One tick of ASSIST: assist and gravity support move towards what the profile wants, within every limit."""
    ticks = min(torque.assist_ticks + 1, profile.ramp_in_ms)
    torque.assist_ticks = ticks
    allowance.opposed(torque)
    guidance.onset(torque)
    scale = torque.authority * allowance.work_left(torque) // 1000
    guidance.guide(torque, profile, angle_mdeg, scale * ticks // profile.ramp_in_ms)
    support(torque, profile, angle_mdeg, scale)
    # What pushes comes off the cap first, so that both parts together stay below it.
    room = profile.cap_unm * ticks // profile.ramp_in_ms - abs(torque.guide_unm + torque.gravity_unm)
    size = damping.wanted(torque, profile, velocity_mdeg_s, guidance.near_target(torque, angle_mdeg))
    damping.damp(torque, size, room, velocity_mdeg_s)
    torque.assist_unm = torque.damping_unm + torque.guide_unm
    torque.damping_from_unm = torque.damping_unm
    torque.guide_from_unm = torque.guide_unm
    torque.ramp_tick = 0
    allowance.spend(torque, velocity_mdeg_s)


def ramping(torque: Torque, stride: int, velocity_mdeg_s: int) -> None:
    """One tick of a jerk-limited way to zero assist: RAMP_TICKS / stride ticks in all. |assist| never rises here.

    It begins where `assisting` last was. Whatever happens on the way can make it quicker, never begin it anew.
    """
    tick = min(torque.ramp_tick + stride, RAMP_TICKS)
    torque.ramp_tick = tick
    torque.guide_unm = div(torque.guide_from_unm * REMAINING[tick], 1000)
    damping.let_go(torque, velocity_mdeg_s)
    both, before = torque.guide_unm + torque.damping_unm, torque.assist_unm
    torque.assist_unm = clamp(both, abs(before)) if both * before > 0 else 0
    torque.assist_ticks = 0
    torque.guide_tick = 0
    torque.onset_ticks = 0


def letting_go(torque: Torque, velocity_mdeg_s: int) -> None:
    """One tick of both, the ramp and the fading of support; at rest, where most ticks are, nothing is left to do."""
    if torque.assist_unm or torque.gravity_unm or torque.ramp_tick < RAMP_TICKS or torque.gravity_tick < WAY_TICKS:
        ramping(torque, 1, velocity_mdeg_s)
        support_less(torque)
        allowance.spend(torque, velocity_mdeg_s)
    if torque.work:
        allowance.recover(torque)


def at_rest(torque: Torque) -> None:
    """No assist and no support at once: the device cannot tell where the arm is."""
    torque.assist_unm = 0
    torque.damping_unm = 0
    torque.guide_unm = 0
    torque.damping_from_unm = 0
    torque.guide_from_unm = 0
    torque.ramp_tick = 0
    torque.assist_ticks = 0
    torque.guide_tick = 0
    support_gone(torque)
