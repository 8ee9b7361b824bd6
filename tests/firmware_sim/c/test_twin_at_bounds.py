"""Each bound of the C, met and passed by one, where it is the reference's: what no sequence comes to by chance."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from firmware_sim import frames, watchdogs
from firmware_sim.c import binding
from firmware_sim.memory import Challenge, Inputs
from firmware_sim.profiles import profile
from firmware_sim.states import State
from firmware_sim.watchdogs import Limits
from tests.firmware_sim.c.test_twin import both
from tests.safety.hand import BRIDGE_NONCE, DEVICE_NONCE, KEY, Hand
from tests.safety.stepping import copied

pytestmark = pytest.mark.skipif(not binding.available(), reason="the C controller is not built")

NAMES = ("angle_low_mdeg", "angle_high_mdeg", "speed_limit_mdeg_s", "tracking_limit_unm")
LEAST, MOST = (-20_000, -19_999, 1, 1), (159_999, 160_000, 600_000, 1_000_000)


def made(limits: tuple[int, ...]) -> binding.CController:
    return binding.CController(KEY, 1, SimpleNamespace(**dict(zip(NAMES, limits, strict=True))))  # type: ignore[arg-type]


def test_limits_hold_up_to_and_including_their_bounds() -> None:
    for bound in (LEAST, MOST):
        assert made(bound).limits == Limits(*bound)
    for at, (low, high) in enumerate(zip(LEAST, MOST, strict=True)):
        for value in (low - 1, high + 1):
            wrong = list(LEAST if value < low else MOST)
            wrong[at] = value
            with pytest.raises(ValueError, match="limits"):
                made(tuple(wrong))
    with pytest.raises(ValueError, match="limits"):
        made((10, 10, 1, 1))


def test_the_device_weighs_the_same_at_every_angle() -> None:
    hand = Hand().to_ready()
    edges = {90_000 * quarter + beside for quarter in range(-4, 7) for beside in (-1_001, -1, 0, 1, 500, 30_700)}
    for angle_mdeg in sorted(edges | set(range(201_000, 201_120))):
        state = replace(hand.state, previous_mdeg=angle_mdeg)  # beyond 200 degrees a doubt, and weight still
        inputs = replace(hand.inputs, angle_mdeg=angle_mdeg, second_angle_mdeg=angle_mdeg)
        both(state, inputs, hand.now_ms + 1)


@pytest.mark.parametrize("field", ["second_angle_mdeg", "angle_mdeg", "previous_mdeg", "velocity_mdeg_s"])
def test_each_doubt_in_the_sensors_of_movement_begins_alike(field: str) -> None:
    hand = Hand().to_ready()
    for bound in (-40_000, -30_000, -5_000, -3_000, 3_000, 5_000, 30_000, 33_000, 27_000, 200_000):
        for by in (-2, -1, 0, 1, 2):
            value = bound + by
            still = {"angle_mdeg": 0, "second_angle_mdeg": 0, "velocity_mdeg_s": 0}
            state = replace(hand.state, previous_mdeg=0)
            if field == "previous_mdeg":
                state.previous_mdeg, still["velocity_mdeg_s"] = value, -1_000 * value
            elif field == "angle_mdeg":
                state.previous_mdeg = value
                still.update(angle_mdeg=value, second_angle_mdeg=value)
            else:
                still[field] = value
            both(state, replace(hand.inputs, **still), hand.now_ms + 1)


def test_each_doubt_in_the_wearers_torque_begins_alike() -> None:
    hand = Hand().to_ready()
    for sign in (-1, 1):
        for by in (-2, -1, 0, 1, 2):
            for user, before in ((20_000_000, 20_000_000), (5_000_000, 0), (2_500_000, -2_500_000)):
                state = replace(hand.state, previous_user_unm=sign * before)
                both(state, replace(hand.inputs, user_torque_unm=sign * user + by), hand.now_ms + 1)


def test_plant_faults_and_the_tick_begin_at_the_same_number() -> None:
    ready = Hand().to_ready()
    now_ms, limits = ready.now_ms + 1, ready.state.limits
    for by in (-1, 0, 1):
        for doubt in (watchdogs.TRACKING_DOUBT - 5, watchdogs.TRACKING_DOUBT - 4, watchdogs.TRACKING_DOUBT, 1, 0):
            state = replace(ready.state, tracking_doubt=doubt)
            both(state, replace(ready.inputs, commanded_unm=limits.tracking_limit_unm + by), now_ms)
        both(ready.state, replace(ready.inputs, velocity_mdeg_s=limits.speed_limit_mdeg_s + by), now_ms)
        for edge in (limits.angle_low_mdeg + by, limits.angle_high_mdeg + by):
            state = replace(ready.state, previous_mdeg=edge)
            both(state, replace(ready.inputs, angle_mdeg=edge, second_angle_mdeg=edge), now_ms)
        for last_ms in (0, 1, 2):
            both(replace(ready.state, last_tick_ms=last_ms), ready.inputs, last_ms + watchdogs.TICK_LIMIT_MS + by)


def test_a_latch_is_cleared_until_the_same_millisecond() -> None:
    hand = Hand().to_follow()
    for by in (-1, 0, 1):
        now_ms = hand.now_ms + 1
        state = replace(
            hand.state, state=State.LATCHED, clear_until_ms=now_ms + by, command_live=True, command_is_hold=True,
            command_ms=now_ms,
        )  # fmt: skip
        both(state, replace(hand.inputs, local_clear=True), now_ms)


@pytest.mark.parametrize("apart_ms", [0, 1, 65_536, 70_000])
def test_trips_and_bus_offs_are_remembered_alike(apart_ms: int) -> None:
    hand = Hand().to_assist()
    for by in (-1, 0, 1):
        for window_ms in (watchdogs.TRIP_WINDOW_MS, watchdogs.BUS_OFF_WINDOW_MS):
            now_ms = 500_000
            first_ms = now_ms - window_ms + by
            state = copied(hand.state)
            state.last_tick_ms, state.command_ms, state.heartbeat_ms = now_ms - 1, now_ms - 100, now_ms - 1
            state.trips = (first_ms - apart_ms, first_ms, first_ms + 1)
            state.bus_offs = (first_ms - apart_ms, first_ms)
            state.assist_since_ms, state.pending = now_ms - 500, None
            both(state, Inputs(), now_ms)  # a command that is overdue
            both(state, Inputs(bus_off=True), now_ms)
            state.trips = (first_ms - apart_ms, first_ms - apart_ms, first_ms)
            both(state, Inputs(), now_ms)
            state.trips = (first_ms, first_ms + 1)
            state.bus_offs = (first_ms,)
            both(state, Inputs(), now_ms)
            both(state, Inputs(bus_off=True), now_ms)


def test_the_oldest_status_that_is_kept_is_an_echo_still() -> None:
    hand = Hand().to_ready()
    now_ms = hand.now_ms + 1
    for limit in (watchdogs.ECHO_LIMIT_MS - 1, watchdogs.ECHO_LIMIT_MS, watchdogs.ECHO_LIMIT_MS + 1):
        for echoes in (
            ((77, now_ms - limit),),
            ((77, now_ms - limit), (78, now_ms)),
            ((76, now_ms), (77, now_ms - limit)),
        ):
            state = replace(hand.state, echoes=echoes)
            for command in (hand.act_cmd(frames.GATE_ACT, 1, echo=77), hand.act_cmd(frames.GATE_HOLD, echo=77)):
                both(state, replace(hand.inputs, frames=(command,)), now_ms)


def test_an_authorisation_late_by_a_tick_counts_as_missing() -> None:
    for late_ms in (watchdogs.AUTH_LIMIT_MS - 1, watchdogs.AUTH_LIMIT_MS, watchdogs.AUTH_LIMIT_MS + 1):
        hand = Hand().to_ready()
        command = hand.act_cmd(frames.GATE_ACT, 1)
        hand.tick(command)
        now_ms = hand.now_ms + late_ms
        state = replace(hand.state, last_tick_ms=now_ms - 1)
        first, second = hand.auth(command), hand.auth(command)
        for received in ((first,), (first, second), (first, hand.act_cmd(frames.GATE_HOLD))):
            both(state, replace(hand.inputs, frames=received), now_ms)


def test_the_only_command_that_is_remembered_can_be_meant() -> None:
    hand = Hand().to_ready()
    state = replace(hand.state, commands=())
    command = hand.act_cmd(frames.GATE_ACT, 1)
    after = both(state, replace(hand.inputs, frames=(command,)), hand.now_ms + 1)
    after = both(after, replace(hand.inputs, frames=(hand.auth(command),)), hand.now_ms + 2)
    assert after.state is State.ASSIST


def test_the_first_tick_of_a_sensor_moves_nothing() -> None:
    hand = Hand().to_ready()
    for speed in (-30_001, -30_000, -29_999, 29_999, 30_000, 30_001):
        state = replace(hand.state, previous_mdeg=None)
        both(state, replace(hand.inputs, velocity_mdeg_s=speed), hand.now_ms + 1)


def test_an_answer_to_clear_arms_nobody() -> None:
    """A challenge of a latch that was cleared meanwhile: the answer is right, and nothing but the clearing follows."""
    hand = Hand().to_follow()
    number = 9
    for purpose in (frames.PURPOSE_ARM, frames.PURPOSE_CLEAR_LATCH):
        for current in (State.FOLLOW, State.READY, State.LATCHED, State.ESTOP):
            challenge = Challenge(hand.now_ms, purpose, number, BRIDGE_NONCE, DEVICE_NONCE)
            state = replace(hand.state, state=current, challenge=challenge, last_session=number)
            answer = hand.response(purpose, session=number)
            after = both(state, replace(hand.inputs, frames=(answer,)), hand.now_ms + 1)
            arms = purpose == frames.PURPOSE_ARM and current in (State.FOLLOW, State.READY)
            assert after.armed is arms
            assert (after.clear_until_ms > 0) is (purpose == frames.PURPOSE_CLEAR_LATCH)


def test_e2e_that_turns_invalid_is_a_trip() -> None:
    hand = Hand().to_ready()
    for jump in range(1, 20):
        far = hand.act_cmd(frames.GATE_HOLD, counter=(hand.counters[frames.ACT_CMD] + jump) & 0xFF)
        broken = far._replace(data=bytes([far.data[0] ^ 1]) + far.data[1:])
        for received in ((far,), (broken,), (broken,) * 2, (broken,) * 4, (far, far, broken, broken)):
            both(hand.state, replace(hand.inputs, frames=received), hand.now_ms + 1)


@pytest.mark.parametrize("verb", range(16))
def test_damping_begins_at_the_same_speed(verb: int) -> None:
    hand = Hand().to_assist()
    half_ms = profile(verb).half_wave_ms
    for speed in (-2, -1, 1, 2, 20_000):
        for guide in (0, 5):
            for half_wave in (half_ms, half_ms + 1):
                state = copied(hand.state)
                state.verb = verb
                law = state.torque
                law.assist_ticks = law.authority = 1_000
                law.wave_ticks = law.last_ticks = law.before_ticks = max(1, half_wave - 1)
                law.last_peak = law.before_peak = 300_000
                law.gain_most, law.guide_tick, law.impulse = 5_000, guide, 0
                law.slow_mean = law.second_mean = 0
                law.fast_mdeg_s = 20_000 if speed > 0 else -20_000
                law.peaks = (1_500_000,) * len(law.peaks)
                both(state, replace(hand.inputs, velocity_mdeg_s=speed), hand.now_ms + 1)


def test_who_falls_back_to_follow_is_neutral_anew() -> None:
    hand = Hand().to_assist()
    for neutral in (1, 2, 3):
        state = copied(hand.state)
        state.state, state.ramp_fault, state.neutral = State.RAMP_DOWN, True, neutral
        state.torque.assist_unm = state.torque.guide_from_unm = state.torque.damping_from_unm = 0
        after = both(state, hand.inputs, hand.now_ms + 1)
        assert (after.state, after.neutral) == (State.FOLLOW, 0)
