"""Arming, latching and the way out of a latch; sensors, plant, own identifiers."""

from __future__ import annotations

import pytest

from firmware_sim import frames
from firmware_sim.frames import Reject
from firmware_sim.memory import COUNT_OWN_ID, ControllerState, Received
from firmware_sim.states import Reason, State
from tests.safety.hand import BOOT_NONCE, KEY, Hand

requirement = pytest.mark.requirement
CLEAR = frames.PURPOSE_CLEAR_LATCH


def latched() -> Hand:
    """A device that has latched and come to rest, with somebody holding."""
    hand = Hand().to_assist()
    hand.tick(Received(frames.CTRL_STATUS, bytes(8)))
    assert hand.state.state == State.LATCHED
    for _ in range(15):
        hand.beat(hand.hold(session=0))
    assert hand.outputs.assist_unm == hand.outputs.gravity_unm == 0
    return hand


@requirement("S6")
@pytest.mark.parametrize("can_id", frames.OWN_IDS)
def test_own_identifier_seen_from_outside_latches(can_id: int) -> None:
    hand = Hand().to_assist()
    hand.tick(Received(can_id, b""))
    assert hand.state.state == State.LATCHED
    assert hand.state.reason == Reason.OWN_ID_SEEN
    hand.tick(Received(can_id, b""))
    assert hand.count(COUNT_OWN_ID) == 2  # counted in the latch too


@requirement("S6")
def test_latched_stays_latched() -> None:
    hand = latched()
    hand.tick(hand.request())
    hand.tick(hand.response())
    for _ in range(50):
        hand.beat(hand.hold())
        hand.tick(local_clear=True)
    assert hand.state.state == State.LATCHED


@requirement("S7")
@pytest.mark.parametrize("missing", ["none", "hold", "challenge", "local", "zero_gravity", "zero_assist", "stale"])
def test_leaving_a_latch_needs_all_four(missing: str) -> None:
    hand = latched()
    hand.state.mac_failures = 1
    if missing != "challenge":
        hand.tick(hand.request(CLEAR))
        hand.tick(hand.response(CLEAR))
        assert hand.state.clear_until_ms == hand.now_ms + 30_000
    if missing == "hold":
        hand.run(150)
    if missing == "stale":
        hand.beat(hand.hold(session=0), milliseconds=1)
        hand.state.clear_until_ms = hand.now_ms + 1
    if missing == "zero_gravity":
        hand.state.torque.gravity_unm = 1
    if missing == "zero_assist":
        hand.state.torque.assist_unm = 1
    hand.tick(local_clear=missing != "local")
    if missing != "none":
        assert hand.state.state == State.LATCHED
        return
    assert hand.state.state == State.SELFTEST
    assert hand.state.reason == Reason.CLEARED
    assert (hand.state.trips, hand.state.bus_offs, hand.state.mac_failures) == ((), (), 0)
    assert hand.state.clear_until_ms == 0
    assert not hand.state.armed
    hand.run(49)
    assert hand.state.state == State.SELFTEST
    hand.run(2)
    assert hand.state.state == State.FOLLOW


@requirement("S7")
def test_a_clearing_holds_for_thirty_seconds_and_no_longer() -> None:
    hand = latched()
    hand.tick(hand.request(CLEAR))
    hand.tick(hand.response(CLEAR))
    until_ms = hand.state.clear_until_ms
    while hand.now_ms < until_ms - 1:
        hand.tick(*((hand.hold(session=0),) if hand.now_ms % 40 == 0 else ()))
    hand.tick(local_clear=True)
    assert hand.state.state == State.LATCHED


@requirement("S7")
def test_the_last_command_must_be_a_hold() -> None:
    hand = latched()
    hand.tick(hand.request(CLEAR))
    hand.tick(hand.response(CLEAR))
    hand.state.command_is_hold = False
    hand.tick(local_clear=True)
    assert hand.state.state == State.LATCHED


@requirement("S7", "P3")
def test_an_estop_is_left_the_same_way() -> None:
    hand = Hand().to_ready()
    hand.tick(Received(frames.STOP, b""))
    hand.tick(hand.request(CLEAR))
    hand.tick(hand.response(CLEAR))
    hand.tick(hand.hold(session=0))
    hand.tick(local_clear=True)
    assert hand.state.state == State.SELFTEST


@requirement("S7")
def test_a_wrong_key_does_not_clear_and_counts_as_mac_failure() -> None:
    hand = latched()
    hand.tick(hand.request(CLEAR))
    hand.tick(hand.response(CLEAR, shared=b"y" * 16))
    assert hand.state.clear_until_ms == 0
    assert hand.state.mac_failures == 1
    hand.tick(hand.hold(session=0))
    hand.tick(local_clear=True)
    assert hand.state.state == State.LATCHED


@requirement("S7")
def test_the_answer_to_an_arming_challenge_does_not_clear() -> None:
    hand = latched()
    hand.tick(hand.request(CLEAR))
    hand.tick(hand.response(frames.PURPOSE_ARM))
    assert hand.count(Reject.MAC) == 1
    assert hand.state.clear_until_ms == 0


@requirement("S10")
def test_h4_implausible_sensors_make_passive_at_once_and_recover_after_half_a_second() -> None:
    hand = Hand().to_assist()
    hand.run(2, second_angle_mdeg=34_000)
    assert hand.state.state == State.ASSIST
    hand.tick(second_angle_mdeg=34_000)
    assert hand.state.state == State.PASSIVE
    assert hand.state.reason == Reason.SENSOR_IMPLAUSIBLE
    out = hand.outputs
    assert (out.assist_unm, out.gravity_unm, out.follow_unm) == (0, 0, 0)
    assert not hand.state.armed
    hand.run(499)
    assert hand.state.state == State.PASSIVE
    assert hand.outputs.follow_unm == 0
    hand.tick()
    assert hand.state.state == State.FOLLOW
    assert hand.outputs.follow_unm != 0


@requirement("S10")
def test_a_jump_of_the_encoder_is_implausible_but_one_alone_passes() -> None:
    hand = Hand().to_ready()
    hand.tick(angle_mdeg=40_000, second_angle_mdeg=40_000)
    assert hand.state.sensor_doubt == 8
    hand.tick(angle_mdeg=40_000, second_angle_mdeg=40_000)
    assert hand.state.sensor_doubt == 7
    hand.run(8, angle_mdeg=40_000, second_angle_mdeg=40_000)
    assert hand.state.sensor_doubt == 0
    assert hand.state.state == State.READY


@requirement("S10")
@pytest.mark.parametrize(
    "wrong",
    [
        {"second_angle_mdeg": 38_000},
        {"velocity_mdeg_s": 51_000},
        {"user_torque_unm": 21_000_000},
    ],
    ids=lambda wrong: next(iter(wrong)),
)
def test_h4_sensors_wrong_in_two_of_three_ticks_end_an_assist(wrong: dict[str, int]) -> None:
    hand = Hand().to_assist()
    for tick in range(12):
        hand.tick(**(wrong if tick % 3 else {}))
    assert (hand.state.state, hand.state.reason) == (State.PASSIVE, Reason.SENSOR_IMPLAUSIBLE)
    assert hand.outputs.assist_unm == hand.outputs.gravity_unm == 0


@requirement("S10")
def test_h4_a_torque_sensor_that_jumps_to_and_fro_is_not_believed() -> None:
    hand = Hand().to_assist()
    for tick in range(6):
        hand.tick(user_torque_unm=2_600_000 * (-1) ** tick)
    assert (hand.state.state, hand.state.reason) == (State.PASSIVE, Reason.SENSOR_IMPLAUSIBLE)


@requirement("S10")
def test_readings_that_are_wrong_at_times_do_not_take_the_device_out() -> None:
    hand = Hand().to_ready()
    for tick in range(900):
        hand.tick(**({"second_angle_mdeg": 40_000} if tick % 10 == 0 else {}))
        assert hand.state.state not in (State.PASSIVE, State.LATCHED)


@requirement("S10")
def test_follow_mode_comes_back_in_a_latch_once_the_doubt_has_leaked() -> None:
    hand = Hand().to_assist()
    hand.tick(Received(frames.CTRL_STATUS, b""))
    hand.run(20, second_angle_mdeg=34_000)
    assert (hand.state.sensor_doubt, hand.outputs.follow_unm) == (32, 0)
    hand.run(8)
    assert (hand.state.sensor_doubt, hand.outputs.follow_unm) == (24, 0)
    hand.tick()
    assert hand.outputs.follow_unm != 0


@requirement("S10", "T5")
def test_h3_support_goes_at_once_when_sensors_fail_in_a_latch() -> None:
    hand = Hand().to_assist(10)
    hand.tick(Received(frames.CTRL_STATUS, b""))
    assert hand.outputs.gravity_unm != 0
    hand.run(2, second_angle_mdeg=34_000)
    assert hand.outputs.gravity_unm != 0
    hand.tick(second_angle_mdeg=34_000)
    assert hand.state.state == State.LATCHED
    assert hand.outputs.gravity_unm == 0
    assert hand.outputs.follow_unm == 0


@requirement("W8", "S6")
@pytest.mark.parametrize(
    ("ticks", "difference", "latched"), [(19, 600_001, False), (20, 600_001, True), (50, 600_000, False)]
)
def test_h4_torque_that_does_not_follow_latches(ticks: int, difference: int, latched: bool) -> None:
    hand = Hand().to_ready()
    hand.run(ticks, commanded_unm=0, measured_unm=-difference)
    assert (hand.state.state == State.LATCHED) == latched
    if latched:
        assert hand.state.reason == Reason.TORQUE_TRACKING
        assert hand.outputs.follow_unm == 0
    else:
        assert hand.state.tracking_doubt == (76 if difference > 600_000 else 0)
        hand.run(76, commanded_unm=0, measured_unm=-600_000)
        assert hand.state.tracking_doubt == 0


@requirement("W8")
@pytest.mark.parametrize(("every", "latched"), [(3, True), (6, False)])
def test_h4_one_good_tick_does_not_clear_a_motor_that_does_not_follow(every: int, latched: bool) -> None:
    hand = Hand().to_ready()
    for tick in range(1500):
        hand.tick(commanded_unm=0, measured_unm=700_000 if tick % every == 0 else 0)
    assert (hand.state.reason == Reason.TORQUE_TRACKING) == latched


@requirement("W8")
@pytest.mark.parametrize(("speed", "latched"), [(400_000, False), (400_001, True), (-400_001, True)])
def test_h4_joint_speed_latches(speed: int, latched: bool) -> None:
    hand = Hand().to_ready()
    there = 30_000 + speed // 1000
    hand.tick(velocity_mdeg_s=speed, angle_mdeg=there, second_angle_mdeg=there)
    assert (hand.state.state == State.LATCHED) == latched
    if latched:
        assert hand.state.reason == Reason.JOINT_SPEED
        assert hand.outputs.follow_unm == 0


@requirement("W8")
@pytest.mark.parametrize(("angle", "latched"), [(0, False), (-1, True), (145_000, False), (145_001, True)])
def test_h4_range_of_motion_latches(angle: int, latched: bool) -> None:
    hand = Hand().to_follow()
    hand.state.previous_mdeg = angle
    hand.tick(angle_mdeg=angle, second_angle_mdeg=angle)
    assert (hand.state.state == State.LATCHED) == latched
    if latched:
        assert hand.state.reason == Reason.RANGE_OF_MOTION
        assert hand.outputs.follow_unm == 0


@requirement("S6")
@pytest.mark.parametrize("healthy", [True, False])
def test_self_test_decides_between_follow_and_latch(healthy: bool) -> None:
    hand = Hand()
    hand.tick(self_test_ok=healthy)
    assert hand.state.state == State.SELFTEST
    assert hand.state.self_test_ms == 1
    hand.run(49, self_test_ok=healthy)
    assert hand.state.state == State.SELFTEST
    assert hand.outputs.follow_unm == 0
    hand.tick(self_test_ok=healthy)
    assert hand.state.state == (State.FOLLOW if healthy else State.LATCHED)
    assert hand.state.reason == (Reason.NONE if healthy else Reason.SELF_TEST_FAILED)


@requirement("S6")
def test_a_failed_known_answer_latches(monkeypatch: pytest.MonkeyPatch, controller: str) -> None:
    if controller == "c":
        pytest.skip("the C has an answer of its own, which tests/firmware_sim/c/test_board.py spoils")
    monkeypatch.setattr("firmware_sim.controller.passed", lambda: False)
    hand = Hand()
    hand.run(60)
    assert hand.state.state == State.LATCHED


def test_power_on_is_boot_with_nothing_armed() -> None:
    state = ControllerState(KEY, BOOT_NONCE)
    assert state.state == State.BOOT
    assert not state.armed
    hand = Hand(state)
    hand.tick()
    assert state.state == State.BOOT  # step never touches what it was given
    assert hand.state.state == State.SELFTEST


@requirement("S6", "T4")
def test_h3_a_latch_takes_assist_down_smoothly_and_support_over_half_a_second() -> None:
    hand = Hand().to_assist(10)
    support = hand.outputs.gravity_unm
    hand.tick(Received(frames.CTRL_HB, b""))
    assert hand.until_zero() == 39
    assert hand.outputs.gravity_unm > support * 0.9
    hand.run(470)
    assert hand.outputs.gravity_unm == 0
    assert hand.outputs.follow_unm != 0  # weight of the device itself is still carried
