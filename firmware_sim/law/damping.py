"""Added damping. It only ever removes energy: in every tick its torque is against the velocity, or zero.

Two things are damped. The whole velocity, by a small drag that stays below what moves a hand. And tremor, at the full
coefficient: the smaller of velocity and fast velocity where both have one sign, no more than the last two half waves.
The leash bounds the impulse that damping may have given to one side lately, whatever made it: a bound on impulse is a
bound on how far a hand can be moved.
"""

from __future__ import annotations

from firmware_sim.law.memory import Torque
from firmware_sim.law.numbers import REMAINING
from firmware_sim.profiles import Profile

RATE_UP_UNM_PER_MS = 10_000  # 10 N m/s
RATE_DOWN_UNM_PER_MS = 50_000
WINDOW_RISE_UNM = 900_000  # |damping| may rise by so much within 250 ms
LEASH_UNM_MS = 15_000_000  # 0.015 N m s
_LEASH_SHIFT = 4  # within 16 ms, were the torque to stay
STRONGEST = 5000  # mN m s/rad


def viscous(damping: int, speed_mdeg_s: int) -> int:
    """Torque in uN m of so many mN m s/rad at a speed."""
    return damping * speed_mdeg_s * 17_453 // 1_000_000


def _tremor(torque: Torque, half_wave_ms: int, velocity_mdeg_s: int) -> int:
    """Speed of the tremor that is to be damped in this tick, mdeg/s; 0 where nothing swings both ways."""
    fast = torque.fast_mdeg_s
    if fast * velocity_mdeg_s <= 0 or torque.wave_ticks > half_wave_ms:
        return 0
    if torque.last_ticks > half_wave_ms or torque.before_ticks > half_wave_ms:
        return 0
    return min(abs(velocity_mdeg_s), abs(fast), torque.last_peak, torque.before_peak)


def wanted(torque: Torque, profile: Profile, velocity_mdeg_s: int, near: bool) -> int:
    """Size of the damping torque that the profile asks for."""
    damping = profile.damping_near if near else profile.damping
    size = viscous(min(damping, torque.gain_most), _tremor(torque, profile.half_wave_ms, velocity_mdeg_s))
    if torque.guide_tick and not near:
        return size  # guidance goes along with the slow movement
    return max(size, min(profile.drag_unm, viscous(damping, abs(velocity_mdeg_s))))


def _leash(torque: Torque, sign: int) -> int:
    """What damping may still give to this side."""
    return (LEASH_UNM_MS - sign * torque.impulse) >> _LEASH_SHIFT


def damp(torque: Torque, size: int, ceiling: int, velocity_mdeg_s: int) -> None:
    """One tick towards `size` against the velocity: within the ceiling, the leash and the rates; never along with it."""
    sign = -1 if velocity_mdeg_s > 0 else 1
    before = max(0, sign * torque.damping_unm)  # what would push is gone at once
    ceiling = min(ceiling, min(torque.peaks) + WINDOW_RISE_UNM)
    size = min(size, ceiling, _leash(torque, sign), before + RATE_UP_UNM_PER_MS)
    slowly = min(before - RATE_DOWN_UNM_PER_MS, viscous(STRONGEST, abs(velocity_mdeg_s)))
    torque.damping_unm = sign * max(0, size, slowly)


def let_go(torque: Torque, velocity_mdeg_s: int) -> None:
    """Damping on a ramp: below the ramp, below what it was, and still never along with the velocity."""
    sign = -1 if velocity_mdeg_s > 0 else 1
    left = sign * torque.damping_from_unm * REMAINING[torque.ramp_tick] // 1000
    most = min(left, _leash(torque, sign), viscous(STRONGEST, abs(velocity_mdeg_s)))
    torque.damping_unm = sign * max(0, min(sign * torque.damping_unm, most))
