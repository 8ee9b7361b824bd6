"""The 1 kHz torque law. Assist (damping, guidance) and gravity support of the wearer's arm are kept apart everywhere.

Integers throughout: torque uN m, angle mdeg (0 hangs down, 90000 is level), velocity mdeg/s, one call per millisecond,
which changes the law's memory in place. Only `assisting` can raise assist; everything else in this module can only lower
it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import pairwise
from operator import attrgetter

from firmware_sim.profiles import Guidance, Profile

RAMP_TICKS = 40
STOP_STRIDE = 4  # the ramp table at four times the pace: zero in 10 ms
GRAVITY_TICKS = 500
RATE_UP_UNM_PER_MS = 10_000  # 10 N m/s
RATE_DOWN_UNM_PER_MS = 50_000
GRAVITY_RATE_UNM_PER_MS = 5_000
WINDOW_RISE_UNM = 1_500_000  # |assist| may rise by so much within 250 ms
WINDOW_SLOTS = 25
WINDOW_SLOT_MS = 10
OPPOSE_FROM_UNM = 500_000
OPPOSE_TO_UNM = 1_500_000
AUTHORITY_RISE_PER_MS = 2
ARM_WEIGHT_UNM = 2_000_000  # the wearer's forearm held level
DEVICE_WEIGHT_UNM = 800_000  # the device's own link held level
ONSET_MDEG_S = 8_000
ONSET_TICKS = 200  # longer than half a period of 3.5 Hz, its first swing included: tremor is no onset (H6)
CONTACT_MDEG_S = 3_000
CONTACT_TICKS = 40
REACH_MDEG = 35_000
REACH_TICKS = 900
NEAR_MDEG = 8_000
GUIDE_STIFFNESS = 60  # uN m per mdeg
CONTACT_PUSH_UNM = 500_000
SLOW_BAND_PER_MILLE = 13  # 2 Hz: the voluntary part of the velocity, for onset and agreement


def div(a: int, b: int) -> int:
    """Quotient rounded towards zero, as C divides; b > 0."""
    return a // b if a >= 0 else -(-a // b)


def clamp(value: int, limit: int) -> int:
    """`value` within -limit..limit."""
    return max(-limit, min(limit, value))


def _minimum_jerk(steps: int) -> tuple[int, ...]:
    """Per mille of the way along 10 s^3 - 15 s^4 + 6 s^5 at k / steps, k = 0..steps."""
    n = steps
    return tuple((1000 * k**3 * (10 * n * n - 15 * n * k + 6 * k * k)) // n**5 for k in range(n + 1))


REMAINING = tuple(1000 - moved for moved in _minimum_jerk(RAMP_TICKS))
REACHED = _minimum_jerk(100)
# Sine of 0..90 degrees in per mille.
SINE = (
    0, 17, 35, 52, 70, 87, 105, 122, 139, 156, 174, 191, 208, 225, 242, 259, 276, 292, 309, 326, 342, 358, 375, 391,
    407, 423, 438, 454, 469, 485, 500, 515, 530, 545, 559, 574, 588, 602, 616, 629, 643, 656, 669, 682, 695, 707, 719,
    731, 743, 755, 766, 777, 788, 799, 809, 819, 829, 839, 848, 857, 866, 875, 883, 891, 899, 906, 914, 921, 927, 934,
    940, 946, 951, 956, 961, 966, 970, 974, 978, 982, 985, 988, 990, 993, 995, 996, 998, 999, 999, 1000, 1000,
)  # fmt: skip
_RISE = (*(after - here for here, after in pairwise(SINE)), 0)  # to the next degree


@dataclass(slots=True)
class Torque:
    """What the law remembers from tick to tick; the default is rest."""

    assist_unm: int = 0
    gravity_unm: int = 0
    from_unm: int = 0  # assist when the running ramp began
    ramp_tick: int = 0
    gravity_from_unm: int = 0
    gravity_tick: int = GRAVITY_TICKS
    assist_ticks: int = 0
    authority: int = 1000  # per mille
    band_mean: int = 0  # low-passed velocity of the profile's band, udeg/s
    slow_mean: int = 0  # low-passed velocity for onset, udeg/s
    onset_ticks: int = 0
    direction: int = 0
    guide_tick: int = 0  # 0: no guidance runs
    guide_from_mdeg: int = 0
    contact_ticks: int = 0
    fade_ticks: int = 0  # 0: not fading
    peaks: tuple[int, ...] = (0,) * WINDOW_SLOTS
    slot_tick: int = 0

    def __copy__(self) -> Torque:
        """As the default copy, at a fraction of its cost."""
        return Torque(*_memory(self))


_memory = attrgetter(*(field.name for field in fields(Torque)))


def sine_per_mille(angle_mdeg: int) -> int:
    """Sine in per mille by table and linear interpolation; any angle."""
    quarter, sign = angle_mdeg % 360_000, 1
    if quarter > 90_000:  # where hardly any arm ever is
        if quarter >= 180_000:
            quarter, sign = quarter - 180_000, -1
        if quarter > 90_000:
            quarter = 180_000 - quarter
    degree = quarter // 1000
    return sign * (SINE[degree] + _RISE[degree] * (quarter % 1000) // 1000)


def follow_torque(angle_mdeg: int, velocity_mdeg_s: int) -> int:
    """Follow mode: cancels the device's own weight and most of its friction. Neither assist nor gravity support."""
    return DEVICE_WEIGHT_UNM * sine_per_mille(angle_mdeg) // 1000 + div(velocity_mdeg_s * 14, 10)


def _authority(torque: Torque, user_unm: int) -> int:
    """Falls at once as the wearer pushes against the assist, comes back slowly."""
    opposing = abs(user_unm) if user_unm * torque.assist_unm < 0 else 0
    if opposing <= OPPOSE_FROM_UNM:
        allowed = 1000
    elif opposing >= OPPOSE_TO_UNM:
        allowed = 0
    else:
        allowed = (OPPOSE_TO_UNM - opposing) * 1000 // (OPPOSE_TO_UNM - OPPOSE_FROM_UNM)
    return min(allowed, torque.authority + AUTHORITY_RISE_PER_MS)


def _onset(torque: Torque) -> None:
    """Counts how long the voluntary velocity has kept one direction above the onset speed."""
    slow = div(torque.slow_mean, 1000)
    direction = 0 if abs(slow) < ONSET_MDEG_S else (1 if slow > 0 else -1)
    if direction == 0 or direction != torque.direction:
        torque.direction = direction
        torque.onset_ticks = 0
    else:
        torque.onset_ticks += 1


def _guidance(torque: Torque, profile: Profile, angle_mdeg: int) -> int:
    """Guidance torque of this tick: never before the wearer's onset, never against the wearer's direction."""
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
        push = GUIDE_STIFFNESS * (wanted - angle_mdeg)
        over = torque.guide_tick > REACH_TICKS
    else:
        slow = abs(div(torque.slow_mean, 1000)) < CONTACT_MDEG_S
        torque.contact_ticks = torque.contact_ticks + 1 if slow else 0
        push = CONTACT_PUSH_UNM * direction
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


def _damping(torque: Torque, profile: Profile, angle_mdeg: int, velocity_mdeg_s: int) -> int:
    """Added damping: on the whole velocity, or only on what lies above the profile's band (H5, H6)."""
    residue = velocity_mdeg_s - div(torque.band_mean, 1000) if profile.band_per_mille else velocity_mdeg_s
    near = (
        torque.guide_tick > 0 and abs(torque.guide_from_mdeg + torque.direction * REACH_MDEG - angle_mdeg) < NEAR_MDEG
    )
    damping = profile.damping_near if near else profile.damping
    return -div(damping * residue * 17_453, 1_000_000)


def _limited(before: int, wanted: int, ceiling: int) -> int:
    """One tick towards `wanted` or the ceiling: up by the rate up, down faster but without a jump, never past zero."""
    if before != 0 and wanted * before <= 0:
        step = min(abs(before), RATE_DOWN_UNM_PER_MS)
        return before - step if before > 0 else before + step
    sign = 1 if wanted > 0 else -1
    size = min(abs(wanted), ceiling, abs(before) + RATE_UP_UNM_PER_MS)
    return sign * max(size, abs(before) - RATE_DOWN_UNM_PER_MS)


def track(torque: Torque, profile: Profile, velocity_mdeg_s: int) -> None:
    """Filters and the 250 ms window; runs in every state, so that an assist never starts from stale memory."""
    if profile.band_per_mille:
        torque.band_mean += profile.band_per_mille * (velocity_mdeg_s - div(torque.band_mean, 1000))
    mean = torque.slow_mean
    torque.slow_mean = mean + SLOW_BAND_PER_MILLE * (
        velocity_mdeg_s - (mean // 1000 if mean >= 0 else -(-mean // 1000))
    )
    torque.slot_tick += 1
    if torque.slot_tick >= WINDOW_SLOT_MS:
        torque.slot_tick = 0
        torque.peaks = (*torque.peaks[1:], abs(torque.assist_unm))


def assisting(torque: Torque, profile: Profile, angle_mdeg: int, velocity_mdeg_s: int, user_unm: int) -> None:
    """One tick of ASSIST: assist and gravity support move towards what the profile wants, within every limit."""
    torque.authority = _authority(torque, user_unm)
    _onset(torque)
    push = _guidance(torque, profile, angle_mdeg)
    ticks = min(torque.assist_ticks + 1, profile.ramp_in_ms)
    cap = profile.cap_unm * torque.authority // 1000 * ticks // profile.ramp_in_ms
    wanted = clamp(push + _damping(torque, profile, angle_mdeg, velocity_mdeg_s), cap)
    ceiling = min(cap, min(torque.peaks) + WINDOW_RISE_UNM)
    support = ARM_WEIGHT_UNM * sine_per_mille(angle_mdeg) // 1000 * profile.gravity_percent // 100
    support = support * ticks // profile.ramp_in_ms
    torque.assist_ticks = ticks
    torque.assist_unm = torque.from_unm = _limited(torque.assist_unm, wanted, ceiling)
    torque.ramp_tick = 0
    torque.gravity_unm += clamp(support - torque.gravity_unm, GRAVITY_RATE_UNM_PER_MS)
    torque.gravity_from_unm = torque.gravity_unm
    torque.gravity_tick = 0


def ramping(torque: Torque, stride: int) -> None:
    """One tick of a jerk-limited way to zero assist: RAMP_TICKS / stride ticks in all. |assist| never rises here.

    It begins where `assisting` last was. Whatever happens on the way can make it quicker, never begin it anew.
    """
    tick = min(torque.ramp_tick + stride, RAMP_TICKS)
    torque.ramp_tick = tick
    torque.assist_unm = div(torque.from_unm * REMAINING[tick], 1000)
    torque.assist_ticks = 0
    torque.guide_tick = 0
    torque.onset_ticks = 0


def supporting_less(torque: Torque) -> None:
    """One tick of the 500 ms in which gravity support fades (H3: no abrupt loss under load)."""
    tick = min(torque.gravity_tick + 1, GRAVITY_TICKS)
    torque.gravity_tick = tick
    torque.gravity_unm = div(torque.gravity_from_unm * REMAINING[tick * RAMP_TICKS // GRAVITY_TICKS], 1000)


def letting_go(torque: Torque) -> None:
    """One tick of both, the ramp and the fading of support; at rest, where most ticks are, nothing is left to do."""
    if torque.assist_unm or torque.gravity_unm or torque.ramp_tick < RAMP_TICKS or torque.gravity_tick < GRAVITY_TICKS:
        ramping(torque, 1)
        supporting_less(torque)


def support_gone(torque: Torque) -> None:
    """Gravity support ends at once: on STOP, or when the device's own sensors are not to be trusted."""
    torque.gravity_unm = 0
    torque.gravity_from_unm = 0
    torque.gravity_tick = GRAVITY_TICKS


def at_rest(torque: Torque) -> None:
    """No assist and no support at once: the device cannot tell where the arm is."""
    torque.assist_unm = 0
    torque.from_unm = 0
    torque.ramp_tick = 0
    torque.assist_ticks = 0
    torque.guide_tick = 0
    support_gone(torque)
