"""Added damping: against the velocity or nothing, within leash, ceiling, window and rates."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from firmware_sim import torque
from firmware_sim.law import damping
from firmware_sim.law.filters import track
from firmware_sim.law.memory import WINDOW_SLOTS, Torque
from firmware_sim.profiles import profile

requirement = pytest.mark.requirement
POUR, CUT, MIX, OPERATE = 10, 4, 15, 14
SHAKING = Torque(
    fast_mdeg_s=9_000,
    wave_ticks=50,
    last_ticks=50,
    before_ticks=50,
    last_peak=8_000,
    before_peak=7_000,
    gain_most=9_000,
)
FULL = replace(SHAKING, peaks=(5_000_000,) * WINDOW_SLOTS)


def shaken(
    verb: int, hertz: float, size: int, ticks: int = 3000, slow: int = 0
) -> tuple[Torque, list[tuple[int, int]]]:
    """The law after so long a tremor, and (velocity, assist) of every tick."""
    law, path = Torque(), []
    for time_ms in range(ticks):
        velocity = slow + round(size * math.sin(2 * math.pi * hertz * time_ms / 1000))
        track(law, velocity, 0)
        torque.assisting(law, profile(verb), 60_000, velocity)
        path.append((velocity, law.assist_unm))
    return law, path


@pytest.mark.parametrize("verb", [1, 3, CUT, 6, MIX, POUR, OPERATE])
@pytest.mark.parametrize("hertz", [4.5, 6.0, 9.0, 12.0])
def test_h5_a_tremor_is_damped_and_never_pushed(verb: int, hertz: float) -> None:
    _, path = shaken(verb, hertz, 1_000)
    assert all(velocity * assist <= 0 for velocity, assist in path)
    taken = -sum(velocity * assist for velocity, assist in path[1000:])
    wholly = sum(velocity * velocity for velocity, _ in path[1000:]) * profile(verb).damping * 0.017453
    assert 0.4 * wholly < taken <= 1.001 * wholly


@pytest.mark.parametrize(("verb", "hertz"), [(CUT, 3.0), (MIX, 3.5)])
def test_h6_band_profiles_leave_what_is_below_their_band_alone(verb: int, hertz: float) -> None:
    _, path = shaken(verb, hertz, 10_000)
    assert all(assist == 0 for _, assist in path[1000:])


@pytest.mark.parametrize("seconds", [0.3, 0.5, 1.0, 2.0])
@pytest.mark.parametrize("verb", [1, CUT, MIX, POUR])
def test_h6_a_reach_is_not_damped_beyond_its_drag(verb: int, seconds: float) -> None:
    law, used, ticks = Torque(), profile(verb), round(1000 * seconds)
    for time_ms in range(3000):
        s = min(time_ms / ticks, 1.0)
        velocity = round(55_000 / seconds * 30 * s * s * (1 - s) ** 2)
        track(law, velocity, 0)
        torque.assisting(law, used, 60_000, velocity)
        assert abs(law.damping_unm) <= used.drag_unm


@pytest.mark.parametrize("sign", [1, -1])
def test_the_tremor_that_is_damped_is_the_least_of_its_signs(sign: int) -> None:
    law = replace(SHAKING, fast_mdeg_s=9_000 * sign)
    assert damping._tremor(law, 50, 6_000 * sign) == 6_000  # the velocity itself
    assert damping._tremor(law, 50, 10_000 * sign) == 7_000  # the lower of two half waves
    assert damping._tremor(replace(law, before_peak=9_500), 50, 10_000 * sign) == 8_000
    assert damping._tremor(replace(law, last_peak=9_500, before_peak=9_500), 50, 10_000 * sign) == 9_000
    assert damping._tremor(law, 50, -6_000 * sign) == 0
    assert damping._tremor(law, 50, 0) == 0
    assert damping._tremor(replace(law, fast_mdeg_s=sign), 50, sign) == 1
    assert damping._tremor(replace(law, fast_mdeg_s=0), 50, 6_000 * sign) == 0
    for late in ("wave_ticks", "last_ticks", "before_ticks"):
        assert damping._tremor(replace(law, **{late: 51}), 50, 6_000 * sign) == 0


def test_what_a_profile_wants() -> None:
    pour = profile(POUR)
    assert damping.wanted(SHAKING, pour, 6_000, near=False) == damping.viscous(5_000, 6_000)
    assert damping.wanted(replace(SHAKING, gain_most=900), pour, 6_000, near=False) == damping.viscous(900, 6_000)
    still = Torque()
    assert damping.wanted(still, pour, 60_000, near=False) == 30_000
    assert damping.wanted(still, pour, -200, near=False) == damping.viscous(5_000, 200)
    guided = Torque(guide_tick=1)
    take = profile(1)
    assert damping.wanted(guided, take, 60_000, near=False) == 0
    assert damping.wanted(guided, take, 100, near=True) == damping.viscous(5_000, 100)
    assert damping.wanted(still, take, 100, near=False) == damping.viscous(3_000, 100)
    assert damping.wanted(still, profile(CUT), 60_000, near=False) == 0


def test_viscous_torque() -> None:
    assert damping.viscous(2_000, 20_000) == pytest.approx(2_000 * math.radians(20) * 1000, rel=1e-4)


@requirement("T6")
@pytest.mark.parametrize("velocity", [200_000, -200_000])
def test_rates_ceiling_and_sides(velocity: int) -> None:
    sign = -1 if velocity > 0 else 1

    def after(before: int, size: int, ceiling: int = 10**9, impulse: int = 0) -> int:
        law = replace(FULL, damping_unm=sign * before, impulse=sign * impulse)
        damping.damp(law, size, ceiling, velocity)
        return sign * law.damping_unm

    assert after(0, 500_000) == 10_000
    assert after(500_000, 500_001) == 500_001
    assert after(500_000, 900_000) == 510_000
    assert after(500_000, 480_000) == 480_000
    assert after(500_000, 0) == 450_000
    assert after(20_000, 0) == 0
    assert after(500_000, 500_000, ceiling=300_000) == 450_000
    assert after(320_000, 500_000, ceiling=300_000) == 300_000
    assert after(100_000, 500_000, ceiling=-5) == 50_000
    assert after(10_000, 500_000, ceiling=-5) == 0
    assert after(-500_000, 500_000) == 10_000  # what would push is gone at once
    assert after(930_000, 2_000_000) == (damping.LEASH_UNM_MS >> 4)  # nothing given yet
    assert after(300_000, 300_000, impulse=15_000_000 - 16 * 280_000) == 280_000
    assert after(300_000, 300_000, impulse=15_000_000) == 250_000
    assert after(900_000, 1_200_000, impulse=-4_000_000) == 910_000


def test_damping_ends_with_the_velocity_however_high_it_was() -> None:
    law = replace(FULL, damping_unm=-500_000)
    damping.damp(law, 0, 10**9, 1_000)
    assert law.damping_unm == -87_265
    damping.damp(law, 0, 10**9, 0)
    assert law.damping_unm == 0


@requirement("T7")
def test_h4_damping_rises_by_a_limited_amount_within_250_ms() -> None:
    law = replace(SHAKING, damping_unm=-905_000, peaks=(0, *(900_000,) * (WINDOW_SLOTS - 1)))
    damping.damp(law, 2_000_000, 10**9, 300_000)
    assert law.damping_unm == -900_000
    law = replace(SHAKING, damping_unm=-905_000, peaks=(20_000, *(900_000,) * (WINDOW_SLOTS - 1)))
    damping.damp(law, 2_000_000, 10**9, 300_000)
    assert law.damping_unm == -915_000


def test_h2_the_ramp_of_damping_is_below_leash_and_velocity() -> None:
    law = replace(FULL, damping_unm=-400_000, damping_from_unm=-400_000, ramp_tick=20)
    damping.let_go(law, 300_000)
    assert law.damping_unm == -200_000
    damping.let_go(law, 900)
    assert law.damping_unm == -78_538
    damping.let_go(law, 300_000)  # and does not come back
    assert law.damping_unm == -78_538
    damping.let_go(law, 1)
    assert law.damping_unm == -87
    law = replace(FULL, damping_unm=-400_000, damping_from_unm=-400_000, ramp_tick=20, impulse=-15_000_000 + 1_600_000)
    damping.let_go(law, 300_000)
    assert law.damping_unm == -100_000
    damping.let_go(law, -300_000)
    assert law.damping_unm == 0
    law = replace(FULL, damping_unm=400_000, damping_from_unm=400_000, ramp_tick=20)
    damping.let_go(law, -300_000)
    assert law.damping_unm == 200_000


def test_the_leash_bounds_the_impulse_to_one_side_whatever_swings() -> None:
    law, used, most = Torque(), profile(POUR), 0
    for time_ms in range(6000):
        # Tremor whose half waves are high one way and long the other: the worst a velocity can do.
        velocity = 90_000 if time_ms % 200 < 60 else -30_000
        track(law, velocity, 0)
        torque.assisting(law, used, 60_000, velocity)
        most = max(most, abs(law.impulse))
    assert 2_000_000 < most <= damping.LEASH_UNM_MS
