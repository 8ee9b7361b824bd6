"""Integer arithmetic of the torque law and its constant tables. Divisors are constants; shifts are arithmetic."""

from __future__ import annotations

from itertools import pairwise

RAMP_TICKS = 40
WAY_TICKS = 500


def div(a: int, b: int) -> int:
    """Quotient rounded towards zero, as C divides; b > 0."""
    return a // b if a >= 0 else -(-a // b)


def clamp(value: int, limit: int) -> int:
    """`value` within -limit..limit."""
    return max(-limit, min(limit, value))


def _minimum_jerk(steps: int, whole: int) -> tuple[int, ...]:
    """Parts of `whole` along 10 s^3 - 15 s^4 + 6 s^5 at k / steps, k = 0..steps."""
    n = steps
    return tuple((whole * k**3 * (10 * n * n - 15 * n * k + 6 * k * k)) // n**5 for k in range(n + 1))


REMAINING = tuple(1000 - moved for moved in _minimum_jerk(RAMP_TICKS, 1000))
REACHED = _minimum_jerk(100, 1000)
# An entry per tick and parts per million, so that no step of it can be felt.
WAY = tuple(1_000_000 - moved for moved in _minimum_jerk(WAY_TICKS, 1_000_000))
# Sine of 0..90 degrees in per mille.
SINE = (
    0, 17, 35, 52, 70, 87, 105, 122, 139, 156, 174, 191, 208, 225, 242, 259, 276, 292, 309, 326, 342, 358, 375, 391,
    407, 423, 438, 454, 469, 485, 500, 515, 530, 545, 559, 574, 588, 602, 616, 629, 643, 656, 669, 682, 695, 707, 719,
    731, 743, 755, 766, 777, 788, 799, 809, 819, 829, 839, 848, 857, 866, 875, 883, 891, 899, 906, 914, 921, 927, 934,
    940, 946, 951, 956, 961, 966, 970, 974, 978, 982, 985, 988, 990, 993, 995, 996, 998, 999, 999, 1000, 1000,
)  # fmt: skip
_RISE = (*(after - here for here, after in pairwise(SINE)), 0)  # to the next degree


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
