"""The torque law as a whole: caps, rates, ramps, and what may never happen in any world."""

from __future__ import annotations

import itertools
import math
from copy import copy
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim import torque
from firmware_sim.law.filters import track
from firmware_sim.law.memory import Torque
from firmware_sim.law.numbers import RAMP_TICKS, REMAINING
from firmware_sim.law.support import ARM_WEIGHT_UNM
from firmware_sim.profiles import NONE, Guidance, Profile, profile
from hilbridge.wire.codec import Codec
from tests.safety.hand import POUR, Hand

requirement = pytest.mark.requirement
TAKE, OPEN, CUT, MIX, OPERATE = 1, 3, 4, 15, 14
ASSISTED = [code for code in range(32) if profile(code).cap_unm]
PULLED = Torque(
    assist_unm=-800_000, damping_unm=-800_000, damping_from_unm=-800_000, gravity_unm=80_000, gravity_from_unm=80_000
)
QUICK = 300_000  # mdeg/s; fast enough not to bound a torque by itself


def wave(hertz: float, size: int, time_ms: int) -> int:
    return round(size * math.sin(2 * math.pi * hertz * time_ms / 1000))


def tick(law: Torque, used: Profile, angle: int, velocity: int, user: int = 0) -> None:
    track(law, velocity, user)
    torque.assisting(law, used, angle, velocity)


@requirement("T4")
@pytest.mark.parametrize(("stride", "ticks"), [(1, 40), (4, 10)])
def test_h2_ramps_reach_exactly_zero_in_their_time_without_a_jerk(stride: int, ticks: int) -> None:
    law, path = copy(PULLED), [PULLED.assist_unm]
    for _ in range(ticks):
        assert law.assist_unm != 0
        torque.ramping(law, stride, QUICK)
        path.append(law.assist_unm)
    assert path[-1] == 0
    steps = [b - a for a, b in itertools.pairwise(path)]
    assert all(step >= 0 for step in steps)
    assert max(abs(b - a) for a, b in itertools.pairwise(steps)) < 0.16 * 800_000 * (stride / 4) ** 2 + 3000
    assert steps[0] < max(steps) / 5
    assert steps[-1] < max(steps) / 5
    over = copy(law)
    torque.ramping(law, stride, QUICK)
    assert law == over


def test_h2_a_ramp_takes_guidance_and_damping_down_together() -> None:
    law = Torque(
        assist_unm=30_000,
        guide_unm=50_000,
        guide_from_unm=50_000,
        damping_unm=-20_000,
        damping_from_unm=-20_000,
        assist_ticks=9,
        guide_tick=9,
        onset_ticks=9,
    )
    for number in range(1, RAMP_TICKS + 1):
        torque.ramping(law, 1, QUICK)
        assert abs(law.assist_unm - 30_000 * REMAINING[number] // 1000) <= 1
    assert (law.assist_ticks, law.guide_tick, law.onset_ticks) == (0, 0, 0)


@pytest.mark.parametrize("sign", [1, -1])
def test_h2_a_ramp_never_rises_nor_changes_side_where_its_parts_fall_apart(sign: int) -> None:
    law = Torque(
        assist_unm=-10_000 * sign,
        guide_unm=40_000 * sign,
        guide_from_unm=40_000 * sign,
        damping_unm=-50_000 * sign,
        damping_from_unm=-50_000 * sign,
    )
    before = 10_000
    for _ in range(RAMP_TICKS):
        torque.ramping(law, 1, -1_000 * sign)  # damping is gone at once, guidance fades
        assert law.damping_unm == 0
        assert 0 <= -law.assist_unm * sign <= before
        before = abs(law.assist_unm)
    law = Torque(
        assist_unm=5_000, guide_unm=40_000, guide_from_unm=40_000, damping_unm=-35_000, damping_from_unm=-35_000
    )
    torque.ramping(law, 1, -1_000)
    assert law.assist_unm == 5_000


def test_the_smallest_torque_is_ramped_as_a_large_one() -> None:
    law = Torque(assist_unm=1, guide_unm=1, guide_from_unm=1)
    torque.ramping(law, 1, 0)
    assert law.assist_unm == 1


@pytest.mark.parametrize("left", ["assist_unm", "gravity_unm", "nothing"])
def test_h2_what_is_let_go_comes_to_rest_and_a_torque_out_of_nowhere_does_not_stay(left: str) -> None:
    law = replace(PULLED, gravity_tick=0)
    for _ in range(500):
        torque.letting_go(law, QUICK)
    rest = replace(PULLED, assist_unm=0, damping_unm=0, gravity_unm=0, ramp_tick=40, gravity_tick=500)
    law.work = 0
    assert law == rest
    if left != "nothing":
        setattr(law, left, 1)
    torque.letting_go(law, QUICK)
    assert law == rest


def test_what_still_pushes_while_it_is_let_go_is_work_too() -> None:
    law = replace(PULLED, gravity_tick=0)
    torque.letting_go(law, QUICK)
    assert law.work == (law.gravity_unm * QUICK >> 20) - 437 > 0


def test_letting_go_gives_work_back_slowly() -> None:
    law = Torque(work=1_000, ramp_tick=40)
    torque.letting_go(law, 0)
    assert law.work == 1_000 - 437
    for _ in range(3):
        torque.letting_go(law, 0)
    assert law.work == 0


def test_at_rest_is_rest() -> None:
    rest = replace(PULLED, ramp_tick=3, assist_ticks=9, guide_tick=9, guide_unm=5, guide_from_unm=5, gravity_top_unm=7)
    torque.at_rest(rest)
    assert rest == Torque()


@requirement("T6")
def test_h4_damping_of_a_tremor_rises_at_most_10_newton_metres_per_second() -> None:
    law, before, most = Torque(), 0, 0
    for time_ms in range(3000):
        tick(law, profile(POUR), 60_000, wave(6.0, 15_000, time_ms))
        assert abs(law.assist_unm) - abs(before) <= 10_000
        before = law.assist_unm
        most = max(most, abs(before))
    assert most > 200_000


@requirement("T8", "T10")
@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 31),
    st.lists(
        st.tuples(
            st.integers(0, 145_000),
            st.integers(-400_000, 400_000),
            st.integers(-4_000_000, 4_000_000),
            st.sampled_from([0.0, 3.0, 6.0, 12.0]),
        ),
        min_size=1,
        max_size=80,
    ),
)
def test_h4_no_world_pushes_torque_past_its_caps_and_rates_or_makes_damping_push(
    verb: int, worlds: list[tuple[int, int, int, float]]
) -> None:
    used, law, number = profile(verb), Torque(), 0
    for angle, speed, user, hertz in worlds:
        for _ in range(40):
            number += 1
            before = copy(law)
            velocity = wave(hertz, speed, number) if hertz else speed
            tick(law, used, angle, velocity, user)
            assert law.damping_unm * velocity <= 0
            assert abs(law.assist_unm + law.gravity_unm) <= used.cap_unm
            assert abs(law.assist_unm) <= used.cap_unm
            assert abs(law.damping_unm) - abs(before.damping_unm) <= 10_000
            assert abs(law.guide_unm - before.guide_unm) <= 500
            assert 0 <= law.gravity_unm <= ARM_WEIGHT_UNM * used.gravity_per_mille // 1000
            assert before.gravity_unm - law.gravity_unm <= before.gravity_top_unm // 500 + 1
            assert 0 <= law.authority <= 1000
            assert 0 <= law.work <= 4_369_000 + 200_000


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(ASSISTED),
    st.integers(1, 1500),
    st.lists(st.integers(-400_000, 400_000), min_size=1, max_size=40),
    st.sampled_from([1, 4]),
)
def test_h2_on_the_way_out_nothing_rises_and_damping_never_pushes(
    verb: int, ticks: int, velocities: list[int], stride: int
) -> None:
    law = Torque()
    for time_ms in range(ticks):
        tick(law, profile(verb), 60_000, wave(5.0, 20_000, time_ms) + 15_000)
    for velocity in itertools.islice(itertools.cycle(velocities), RAMP_TICKS):
        before = law.assist_unm
        torque.ramping(law, stride, velocity)
        assert abs(law.assist_unm) <= abs(before)
        assert law.assist_unm * before >= 0
        assert law.damping_unm * velocity <= 0
    assert law.assist_unm == 0


@requirement("T10")
def test_parts_of_torque_are_kept_apart() -> None:
    hand = Hand().to_assist(POUR, periods=12)
    out = hand.outputs
    assert out.assist_unm == -30_000
    assert out.gravity_unm == 40_000  # a twenty-fifth of the forearm's weight at 30 degrees
    assert out.follow_unm == torque.follow_torque(30_000, 20_000)
    hand.tick(hand.hold())
    hand.until_zero()
    assert hand.outputs.assist_unm == 0
    assert hand.outputs.gravity_unm > 39_000
    assert hand.outputs.follow_unm == out.follow_unm


@pytest.mark.parametrize(("guide", "left"), [(0, 100_000), (60_000, 40_000), (-60_000, 160_000)])
def test_what_pushes_comes_off_the_cap_before_damping(guide: int, left: int) -> None:
    law = Torque(
        gravity_unm=900_000,
        gravity_from_unm=900_000,
        gravity_top_unm=0,
        guide_unm=guide,
        assist_ticks=300,
        fast_mdeg_s=-60_000,
        wave_ticks=40,
        last_ticks=40,
        before_ticks=40,
        last_peak=60_000,
        before_peak=60_000,
        gain_most=3_000,
        damping_unm=195_000,
        peaks=(900_000,) * 25,
    )
    torque.assisting(law, profile(CUT), 60_000, -60_000)
    assert law.damping_unm == pytest.approx(max(left, 145_000), abs=600)


@requirement("T8")
def test_profiles_are_what_the_bar_leaves_of_the_contracts_table() -> None:
    codes = Codec().messages["ACT_CMD"].signals[1].codes
    assert codes is not None
    reach, opening, cut, mix, hold, operate = (
        (3000, 5000, 30_000, 180, 20, Guidance.MINIMUM_JERK),
        (3000, 3000, 30_000, 180, 16, Guidance.UNTIL_CONTACT),
        (3000, 3000, 0, 143, 0, Guidance.NEVER),
        (3000, 3000, 0, 125, 16, Guidance.NEVER),
        (5000, 5000, 30_000, 180, 40, Guidance.NEVER),
        (2000, 2000, 30_000, 180, 0, Guidance.NEVER),
    )
    table = {
        ("Take", "Put", "Transfer"): (*reach, 2_000_000, 300, 200),
        ("Open", "Close", "Turn on", "Turn off"): (*opening, 1_500_000, 300, 150),
        ("Cut", "Divide/Pull Apart", "Crack", "Compress", "Squeeze"): (*cut, 1_000_000, 300, 150),
        ("Mix", "Wash", "Spread", "Clean/Wipe", "Dry"): (*mix, 1_000_000, 400, 200),
        ("Inspect/Read",): (*hold, 1_500_000, 400, 300),
        ("Pour",): (*hold, 2_000_000, 400, 500),
        ("Operate",): (*operate, 1_000_000, 300, 150),
    }
    named = {codes[name]: Profile(*values) for names, values in table.items() for name in names}
    assert {code: profile(code) for code in ASSISTED} == named
    # Whoever should ever ask for the torque of a verb that is not assisted gets nothing.
    assert len(Guidance) == 3  # none of them another's second name
    assert profile(0) == Profile(0, 0, 0, 0, 0, Guidance.NEVER, 0, 1, 1)


@requirement("T8", "P5")
@pytest.mark.parametrize("code", [0, 5, 22, 25, 30, 31, 32, -1, 255])
def test_h1_what_is_not_assisted_has_no_torque_at_all(code: int) -> None:
    assert profile(code) == NONE
    assert profile(code).cap_unm == 0


def test_follow_cancels_weight_and_friction_of_the_device() -> None:
    assert torque.follow_torque(90_000, 0) == 800_000
    assert torque.follow_torque(0, 10_000) == 14_000
    assert torque.follow_torque(0, -10_000) == -14_000
