"""The torque law: ramps, rates, caps, windows, authority, guidance; assist and gravity support kept apart."""

from __future__ import annotations

import itertools
import math
from copy import copy
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim import torque
from firmware_sim.device import Device
from firmware_sim.memory import ControllerState
from firmware_sim.plant.actuator import LIMIT_NM, Actuator
from firmware_sim.plant.arm import STOP_HIGH, STOP_LOW, WEARERS, Arm, wanted_path, wearer_torque
from firmware_sim.profiles import NONE, PROFILES, Guidance, Profile, profile
from firmware_sim.states import State
from firmware_sim.torque import Torque
from hilbridge.wire.codec import Codec
from tests.safety.hand import POUR, TAKE, Hand

requirement = pytest.mark.requirement
REACH = profile(TAKE)
PULLED = Torque(assist_unm=-1_200_000, from_unm=-1_200_000, gravity_unm=900_000, gravity_from_unm=900_000)


@requirement("T4")
@pytest.mark.parametrize(("stride", "ticks"), [(1, 40), (4, 10)])
def test_h2_ramps_reach_exactly_zero_in_their_time_without_a_jerk(stride: int, ticks: int) -> None:
    law, path = copy(PULLED), [PULLED.assist_unm]
    for _ in range(ticks):
        assert law.assist_unm != 0
        torque.ramping(law, stride)
        path.append(law.assist_unm)
    assert path[-1] == 0
    steps = [b - a for a, b in itertools.pairwise(path)]
    assert all(step >= 0 for step in steps)
    assert max(abs(b - a) for a, b in itertools.pairwise(steps)) < 0.16 * 1_200_000 * (stride / 4) ** 2 + 3000
    assert steps[0] < max(steps) / 5
    assert steps[-1] < max(steps) / 5
    over = copy(law)
    torque.ramping(law, stride)
    assert law == over


@requirement("T5")
def test_h3_gravity_support_fades_over_500_ms() -> None:
    law = replace(PULLED, gravity_tick=0)
    path = [law.gravity_unm]
    for _ in range(500):
        torque.supporting_less(law)
        path.append(law.gravity_unm)
    assert path[-1] == 0
    assert path[250] == pytest.approx(450_000, abs=20_000)
    assert path[450] > 0
    assert all(b <= a for a, b in itertools.pairwise(path))
    assert max(a - b for a, b in itertools.pairwise(path)) < 60_000
    faded = copy(law)
    torque.supporting_less(law)
    assert law == faded


@pytest.mark.parametrize("left", ["assist_unm", "gravity_unm", "nothing"])
def test_h2_what_is_let_go_comes_to_rest_and_a_torque_out_of_nowhere_does_not_stay(left: str) -> None:
    law = replace(PULLED, gravity_tick=0)
    for _ in range(500):
        torque.letting_go(law)
    rest = replace(PULLED, assist_unm=0, gravity_unm=0, ramp_tick=40, gravity_tick=500)
    assert law == rest
    if left != "nothing":
        setattr(law, left, 1)
    torque.letting_go(law)
    assert law == rest


@requirement("T5", "S10")
def test_h3_support_can_go_at_once() -> None:
    gone = replace(PULLED, gravity_tick=3)
    torque.support_gone(gone)
    assert (gone.gravity_unm, gone.gravity_from_unm, gone.gravity_tick) == (0, 0, 500)
    assert gone.assist_unm == PULLED.assist_unm
    rest = replace(PULLED, ramp_tick=3, assist_ticks=9, guide_tick=9)
    torque.at_rest(rest)
    assert rest == Torque()


def assist(ticks: int, used: Profile = REACH, law: Torque | None = None, **world: int) -> list[Torque]:
    """The law for so many ticks of ASSIST in a world that does not change."""
    law = copy(law or Torque())
    angle, velocity, user = world.get("angle", 90_000), world.get("velocity", -90_000), world.get("user", 0)
    path = []
    for _ in range(ticks):
        tick(law, used, angle, velocity, user)
        path.append(copy(law))
    return path


def tick(law: Torque, used: Profile, angle: int, velocity: int, user: int) -> None:
    torque.track(law, used, velocity)
    torque.assisting(law, used, angle, velocity, user)


@requirement("T6", "T8")
def test_h4_assist_rises_at_most_10_newton_metres_per_second_to_its_cap() -> None:
    path = assist(1500, velocity=-300_000)
    before = 0
    for law in path:
        assert law.assist_unm - before <= 10_000
        before = law.assist_unm
    assert path[-1].assist_unm == REACH.cap_unm
    assert path[29].assist_unm < 300_000


@requirement("T7")
def test_h4_assist_rises_at_most_so_much_within_250_ms() -> None:
    quick = REACH._replace(cap_unm=5_000_000, ramp_in_ms=1)
    sizes = [0] + [law.assist_unm for law in assist(1200, quick, velocity=-300_000)]
    assert max(sizes) == 5_000_000
    for later in range(250, len(sizes)):
        assert sizes[later] - sizes[later - 250] <= torque.WINDOW_RISE_UNM + 100_000
    rise = sizes.index(next(size for size in sizes if size >= 1_500_000))
    assert 149 <= rise <= 151
    assert sizes[rise + 60] == 1_500_000  # the window holds it there
    assert sizes[rise + 130] > 1_500_000


@pytest.mark.parametrize(
    ("before", "wanted", "after"),
    [(1, 1, 1), (1, -5, 0), (-1, 5, 0), (0, 1, 1), (0, -1, -1), (60_000, -1, 10_000), (60_000, 0, 10_000), (0, 0, 0)],
)
def test_single_units_of_torque_move_as_large_ones_do(before: int, wanted: int, after: int) -> None:
    assert torque._limited(before, wanted, 1_000_000) == after


@requirement("T8")
@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 31),
    st.lists(
        st.tuples(st.integers(0, 145_000), st.integers(-400_000, 400_000), st.integers(-4_000_000, 4_000_000)),
        min_size=1,
        max_size=80,
    ),
)
def test_h4_no_world_pushes_assist_past_its_cap_or_rate(verb: int, worlds: list[tuple[int, int, int]]) -> None:
    used, law = profile(verb), Torque()
    for angle, velocity, user in worlds:
        for _ in range(7):
            before = law.assist_unm
            tick(law, used, angle, velocity, user)
            assert abs(law.assist_unm) <= used.cap_unm
            assert abs(law.assist_unm) - abs(before) <= torque.RATE_UP_UNM_PER_MS
            assert before * law.assist_unm >= 0  # never through zero in one tick
            assert 0 <= law.authority <= 1000
            assert 0 <= law.gravity_unm <= torque.ARM_WEIGHT_UNM * used.gravity_percent // 100


@requirement("T9")
@pytest.mark.parametrize(
    ("user", "authority"),
    [
        (0, 1000),
        (-500_000, 1000),
        (-500_001, 999),
        (-1_000_000, 500),
        (-1_500_000, 0),
        (-3_000_000, 0),
        (3_000_000, 1000),
    ],
)
def test_h1_authority_falls_as_the_wearer_opposes(user: int, authority: int) -> None:
    law = assist(600)[-1]
    assert law.assist_unm > 0
    opposed = assist(1, law=law, user=user)[0]
    assert opposed.authority == authority
    later = assist(40, law=law, user=user)[-1]
    assert later.assist_unm <= REACH.cap_unm * min(authority + 80, 1000) // 1000


@requirement("T9")
def test_h1_authority_comes_back_slowly() -> None:
    law = replace(assist(600)[-1], authority=0, assist_unm=100_000)
    assert [step.authority for step in assist(3, law=law)] == [2, 4, 6]
    assert assist(600, law=law)[-1].authority == 1000


@requirement("T10")
def test_parts_of_torque_are_kept_apart() -> None:
    hand = Hand().to_assist(POUR)
    out = hand.outputs
    assert out.assist_unm != 0
    assert out.gravity_unm == 500_000  # half of the forearm's weight at 30 degrees
    assert out.follow_unm == torque.follow_torque(30_000, 20_000)
    hand.tick(hand.hold())
    hand.until_zero()
    assert hand.outputs.assist_unm == 0
    assert hand.outputs.gravity_unm > 450_000
    assert hand.outputs.follow_unm == out.follow_unm


def test_h5_damping_opposes_the_movement() -> None:
    used = profile(14)
    one_way = assist(400, used, velocity=-20_000)[-1].assist_unm
    assert one_way == pytest.approx(2000 * 20_000 * math.pi / 180, rel=1e-3)
    assert assist(400, used, velocity=20_000)[-1].assist_unm == -one_way


@pytest.mark.parametrize("verb", [4, 8])
def test_h6_band_profiles_leave_slow_movement_alone_and_damp_tremor(verb: int) -> None:
    used = profile(verb)

    def peak(hertz: float) -> int:
        law, most = Torque(), 0
        for time_ms in range(3000):
            velocity = round(4_000 * math.sin(2 * math.pi * hertz * time_ms / 1000))
            tick(law, used, 60_000, velocity, 0)
            most = max(most, abs(law.assist_unm) if time_ms > 1500 else 0)
        return most

    assert peak(0.3) < 0.15 * peak(8.0)


@pytest.mark.parametrize("hertz", [3.5, 5.0, 8.0])
def test_h6_tremor_is_no_onset(hertz: float) -> None:
    law = Torque()
    for time_ms in range(4000):
        velocity = round(200_000 * math.sin(2 * math.pi * hertz * time_ms / 1000))
        tick(law, REACH, 60_000, velocity, 0)
        assert law.guide_tick == 0


@pytest.mark.parametrize("sign", [1, -1])
def test_h1_guidance_starts_only_after_the_wearers_onset_and_in_its_direction(sign: int) -> None:
    # No damping, so that what is left is guidance.
    used = REACH._replace(damping=0, damping_near=0)
    path = assist(700, used, velocity=sign * 10_000, angle=60_000)
    first = next(number for number, law in enumerate(path) if law.guide_tick)
    assert 199 <= first <= 350
    assert all(law.assist_unm == 0 for law in path[:first])
    assert path[-1].assist_unm * sign > 0
    assert all(law.assist_unm * sign >= 0 for law in path)


def test_h1_guidance_never_starts_without_onset() -> None:
    used = REACH._replace(damping=0, damping_near=0)
    for velocity in (0, 7_900, -7_900):
        assert all(law.assist_unm == 0 for law in assist(1500, used, velocity=velocity))


def test_h1_guidance_ends_when_the_wearer_stops_or_turns() -> None:
    used = REACH._replace(damping=0, damping_near=0)
    law = assist(700, used, velocity=20_000, angle=60_000)[-1]
    assert law.guide_tick > 0
    stopped = assist(400, used, law=law, velocity=0, angle=60_000)
    assert stopped[-1].guide_tick == 0
    assert stopped[-1].assist_unm == 0


def test_guidance_fades_after_the_reach_over_the_ramp_out() -> None:
    used = REACH._replace(damping=0, damping_near=0, ramp_out_ms=200)
    law = assist(500, used, velocity=20_000, angle=60_000)[-1]
    path = assist(1200, used, law=law, velocity=20_000, angle=60_000)
    ended = next(number for number, step in enumerate(path) if step.guide_tick == 0)
    fading = [step.fade_ticks for step in path[:ended] if step.fade_ticks]
    assert fading == list(range(1, 201))
    assert path[ended].onset_ticks == 0


def test_near_the_target_damping_is_stronger() -> None:
    law = Torque(guide_tick=500, guide_from_mdeg=60_000, direction=1)
    assert torque._damping(law, REACH, 95_000, 10_000) == torque._damping(law, REACH, 60_000, 10_000) * 5000 // 3000
    assert torque._damping(law, REACH, 87_001, 10_000) < torque._damping(law, REACH, 87_000, 10_000)
    assert torque._damping(replace(law, guide_tick=0), REACH, 95_000, 10_000) == torque._damping(
        law, REACH, 60_000, 10_000
    )


@pytest.mark.parametrize("sign", [1, -1])
def test_until_contact_pushes_along_and_lets_go_on_contact(sign: int) -> None:
    used = profile(3)._replace(damping=0, damping_near=0)
    assert used.guidance == Guidance.UNTIL_CONTACT
    moving = assist(600, used, velocity=sign * 20_000)
    assert moving[-1].assist_unm == sign * torque.CONTACT_PUSH_UNM
    touched = assist(800, used, law=moving[-1], velocity=0)
    assert touched[-1].assist_unm == 0
    assert touched[-1].guide_tick == 0


def test_never_guided_verbs_are_never_guided() -> None:
    used = profile(4)._replace(damping=0, damping_near=0)
    assert all(law.assist_unm == 0 for law in assist(1500, used, velocity=50_000))


@requirement("T8")
def test_profiles_are_the_table_of_the_contract() -> None:
    codes = Codec().messages["ACT_CMD"].signals[1].codes
    assert codes is not None
    reach, opening, cut, mix, inspect = (
        (3000, 5000, 30, 1, 2.0),
        (3000, 20, 2, 1.5),
        (3000, 0, 0, 1.0),
        (3000, 20, 0, 1.0),
        (5000, 50, 0, 1.5),
    )
    for name in ("Take", "Put", "Transfer"):
        p = profile(codes[name])
        assert (p.damping, p.damping_near, p.gravity_percent, p.guidance, p.cap_unm / 1e6) == reach
        assert (p.ramp_in_ms, p.ramp_out_ms, p.band_per_mille) == (300, 200, 0)
    for name in ("Open", "Close", "Turn on", "Turn off"):
        p = profile(codes[name])
        assert (p.damping, p.gravity_percent, p.guidance, p.cap_unm / 1e6) == opening
        assert (p.ramp_in_ms, p.ramp_out_ms, p.band_per_mille) == (300, 150, 0)
    for name in ("Cut", "Divide/Pull Apart", "Crack", "Compress", "Squeeze"):
        p = profile(codes[name])
        assert (p.damping, p.gravity_percent, p.guidance, p.cap_unm / 1e6) == cut
        assert (p.ramp_in_ms, p.ramp_out_ms, p.band_per_mille) == (300, 150, round(2 * math.pi * 3.5))
    for name in ("Mix", "Wash", "Spread", "Clean/Wipe", "Dry"):
        p = profile(codes[name])
        assert (p.damping, p.gravity_percent, p.guidance, p.cap_unm / 1e6) == mix
        assert (p.ramp_in_ms, p.ramp_out_ms, p.band_per_mille) == (400, 200, round(2 * math.pi * 4))
    p = profile(codes["Inspect/Read"])
    assert (p.damping, p.gravity_percent, p.guidance, p.cap_unm / 1e6) == inspect
    p = profile(codes["Pour"])
    assert (p.damping, p.gravity_percent, p.guidance, p.cap_unm) == (5000, 50, 0, 2_000_000)
    assert (p.ramp_in_ms, p.ramp_out_ms) == (400, 500)
    p = profile(codes["Operate"])
    assert (p.damping, p.gravity_percent, p.guidance, p.cap_unm) == (2000, 0, 0, 1_000_000)


@requirement("T8", "P5")
@pytest.mark.parametrize("code", [0, 5, 22, 25, 30, 31, 32, -1, 255])
def test_h1_what_is_not_assisted_has_no_torque_at_all(code: int) -> None:
    assert profile(code) == NONE
    assert profile(code).cap_unm == 0
    assert len(PROFILES) == 32


def test_sine_table_is_a_sine() -> None:
    assert tuple(round(1000 * math.sin(math.radians(degree))) for degree in range(91)) == torque.SINE
    for angle in range(-400_000, 400_000, 977):
        assert torque.sine_per_mille(angle) == pytest.approx(1000 * math.sin(math.radians(angle / 1000)), abs=2)


def test_follow_cancels_weight_and_friction_of_the_device() -> None:
    assert torque.follow_torque(90_000, 0) == 800_000
    assert torque.follow_torque(0, 10_000) == 14_000
    assert torque.follow_torque(0, -10_000) == -14_000


def test_division_rounds_towards_zero_as_c_does() -> None:
    assert (torque.div(7, 2), torque.div(-7, 2), torque.div(0, 3), torque.div(-1, 3)) == (3, -3, 0, 0)


@requirement("T4")
def test_rates_towards_zero_never_cross_it() -> None:
    assert torque._limited(30_000, -500_000, 10**9) == 0
    assert torque._limited(-30_000, 500_000, 10**9) == 0
    assert torque._limited(130_000, -500_000, 10**9) == 80_000
    assert torque._limited(-130_000, 0, 10**9) == -80_000
    assert torque._limited(0, -500_000, 10**9) == -10_000
    assert torque._limited(0, 0, 10**9) == 0
    assert torque._limited(500_000, 100_000, 10**9) == 450_000
    assert torque._limited(500_000, 480_000, 10**9) == 480_000
    assert torque._limited(500_000, 600_000, 300_000) == 450_000
    assert torque._limited(-500_000, -600_000, 10**9) == -510_000


# The physical world behind the controller


@pytest.mark.parametrize("wearer", WEARERS)
def test_the_arm_stays_where_an_arm_can_be(wearer: str) -> None:
    device = Device(ControllerState(b"k" * 16, 1), wearer)
    for _ in range(9000):
        device.tick((), 0)
        assert STOP_LOW - 0.1 < device.arm.angle < STOP_HIGH + 0.1
    assert device.state.state == State.FOLLOW


def test_the_arm_hangs_and_its_stops_hold() -> None:
    arm = Arm(math.radians(60), 0.0)
    for _ in range(5000):
        arm.step(0.0, 0.0, 0.001)
    assert arm.angle == pytest.approx(0.0, abs=0.05)
    for _ in range(3000):
        arm.step(0.0, 8.0, 0.001)
    assert arm.angle == pytest.approx(STOP_HIGH, abs=0.15)


def test_a_reach_goes_out_and_back() -> None:
    assert wanted_path("reach", 0.0)[0] == pytest.approx(math.radians(40))
    assert wanted_path("reach", 1.5) == (pytest.approx(math.radians(95)), 0.0)
    assert wanted_path("reach", 2.5)[1] < 0
    assert wanted_path("still", 3.0) == (math.radians(45.0), 0.0)
    assert wearer_torque("tremor", Arm(), 0.0416) > wearer_torque("reach", Arm(), 0.0416) + 0.8


def test_h4_actuator_lags_saturates_and_breaks_as_told() -> None:
    motor = Actuator()
    for _ in range(10):
        motor.step(2.0, 0.001)
    assert motor.torque_nm == pytest.approx(2.0, rel=0.02)
    for _ in range(30):
        motor.step(99.0, 0.001)
    assert motor.torque_nm == pytest.approx(LIMIT_NM)
    for _ in range(30):
        motor.step(-99.0, 0.001)
    assert motor.torque_nm == pytest.approx(-LIMIT_NM)
    stuck = Actuator(1.0, stuck=True)
    stuck.step(-1.0, 0.001)
    assert stuck == Actuator(1.0, stuck=True)
    weak = Actuator(gain=0.5)
    weak.step(2.0, 1.0)
    assert weak.torque_nm < 1.01


@requirement("W8")
@pytest.mark.parametrize("fault", ["stuck", "gain", "encoder"])
def test_h4_the_device_finds_a_broken_motor_or_encoder(fault: str) -> None:
    device = Device(ControllerState(b"k" * 16, 1), "sway")
    for _ in range(200):
        device.tick((), 0)
    if fault == "stuck":
        device.break_motor(stuck=True)
    elif fault == "gain":
        device.break_motor(gain=-1.0)
    else:
        device.encoder_offset_mdeg = 4000
    for _ in range(3000):
        device.tick((), 0)
    record = device.record()
    if fault == "encoder":
        assert record["state"] == "Passive"
        assert record["follow_nm"] == 0
    elif fault == "gain":
        assert (record["state"], record["reason"]) == ("Latched", "TorqueTracking")
    else:
        assert record["state"] in ("Follow", "Latched")  # stuck near what follow mode asks is within the limit


@requirement("W6")
def test_an_injected_overrun_is_found() -> None:
    device = Device(ControllerState(b"k" * 16, 1))
    for _ in range(100):
        device.tick((), 0)
    device.skip(5)
    device.tick((), 0)
    assert device.record()["reason"] == "TickOverrun"
