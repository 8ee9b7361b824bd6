"""Every watchdog at its limit and one tick before it, and the reaction times at every phase."""

from __future__ import annotations

import pytest

from firmware_sim import frames, watchdogs
from firmware_sim.frames import Reject
from firmware_sim.memory import COUNT_TRIPS, Received
from firmware_sim.states import Reason, State
from tests.safety.hand import POUR, TAKE, Hand

requirement = pytest.mark.requirement


@requirement("W1", "T1")
def test_h2_command_watchdog_trips_at_100_ms_and_ends_in_follow() -> None:
    hand = Hand().to_assist()
    fed_ms = hand.state.command_ms
    hand.tick(hand.heartbeat())
    while hand.now_ms < fed_ms + 99:
        hand.tick()
    assert hand.state.state == State.ASSIST
    hand.tick()
    assert hand.state.state == State.RAMP_DOWN
    assert hand.state.reason == Reason.COMMAND_TIMEOUT
    assert hand.state.ramp_fault
    assert not hand.state.command_live
    while hand.outputs.assist_unm:
        hand.tick()
    assert hand.now_ms - fed_ms <= 140
    hand.tick()
    assert hand.state.state == State.FOLLOW
    assert hand.state.reason == Reason.COMMAND_TIMEOUT
    assert hand.count(COUNT_TRIPS) == 1
    assert not hand.state.armed  # what was made before the silence is worthless after it


@requirement("T1", "W1")
@pytest.mark.parametrize("verb", [TAKE, POUR])
def test_h2_silence_gives_zero_assist_within_150_ms_at_every_phase_of_the_cycle(verb: int) -> None:
    started = Hand().to_assist(verb)
    for phase in range(40):
        hand = Hand(started.state)
        hand.__dict__.update(started.__dict__ | {"counters": dict(started.counters), "log": []})
        hand.tick(*hand.act(verb))
        hand.run(phase)
        hand.tick(hand.heartbeat())
        fed_ms = hand.state.command_ms
        hand.until_zero()
        assert hand.now_ms - fed_ms <= 150
        hand.tick()
        assert hand.state.state == State.FOLLOW


@requirement("T2")
def test_h2_hold_gives_zero_assist_within_60_ms_at_every_phase() -> None:
    started = Hand().to_assist()
    for phase in range(80):
        hand = Hand(started.state)
        hand.__dict__.update(started.__dict__ | {"counters": dict(started.counters), "log": []})
        for _ in range(phase):
            hand.tick(*(hand.act() if hand.now_ms % 40 == 0 else ()))
        hand.tick(hand.hold(), hand.heartbeat())
        held_ms = hand.now_ms
        hand.until_zero()
        assert hand.now_ms - held_ms <= 40
        hand.tick()
        assert hand.state.state == State.READY


@requirement("T3", "P3")
@pytest.mark.parametrize("data", [b"", b"\x01\x02"])
@pytest.mark.parametrize("before", ["assist", "ramp"])
def test_h2_stop_gives_zero_assist_within_20_ms_whatever_the_frame_carries(data: bytes, before: str) -> None:
    hand = Hand().to_assist(POUR)
    if before == "ramp":
        hand.tick(hand.hold())
        hand.run(3)
    assert hand.state.torque.gravity_unm != 0
    hand.tick(Received(frames.STOP, data))
    assert hand.state.state == State.ESTOP
    assert hand.outputs.gravity_unm == 0
    assert hand.until_zero() <= 10
    assert hand.state.reason == Reason.STOP_RECEIVED
    assert not hand.state.armed
    for _ in range(300):
        hand.tick(hand.hold(), hand.heartbeat())
    assert hand.state.state == State.ESTOP


@requirement("P14")
def test_one_lost_command_does_not_trip() -> None:
    hand = Hand().to_assist()
    for _ in range(20):
        hand.beat(*hand.act(), milliseconds=40)
        hand.act()  # made, never delivered
        hand.run(40)
        assert hand.state.state == State.ASSIST
    assert hand.count(COUNT_TRIPS) == 0


@requirement("W5")
def test_h2_heartbeat_watchdog_disarms_at_250_ms() -> None:
    hand = Hand().to_assist()
    beat_ms = hand.state.heartbeat_ms
    while hand.now_ms < beat_ms + 249:
        hand.tick(*(hand.act() if hand.now_ms % 20 == 0 else ()))
    assert hand.state.state == State.ASSIST
    hand.tick()
    assert not hand.state.armed
    assert hand.state.session == 0
    assert hand.state.key == b""
    assert hand.state.freshness == 0
    assert hand.state.state == State.RAMP_DOWN
    assert hand.state.reason == Reason.HEARTBEAT_TIMEOUT
    assert hand.count(COUNT_TRIPS) == 1


@requirement("W5")
def test_heartbeat_loss_in_follow_disarms_without_a_trip() -> None:
    hand = Hand().to_follow().arm()
    hand.run(250)
    assert not hand.state.armed
    assert hand.state.trips == ()
    assert hand.count(COUNT_TRIPS) == 0


@requirement("W7")
def test_h2_assist_dwell_ends_at_ten_seconds_and_needs_neutral_again() -> None:
    hand = Hand().to_ready()
    hand.tick(*hand.act())
    since_ms = hand.state.assist_since_ms
    assert since_ms == hand.now_ms
    while hand.now_ms < since_ms + 9_999:
        hand.tick(*((*hand.act(), hand.heartbeat()) if hand.now_ms % 40 == 0 else ()))
    assert hand.state.state == State.ASSIST
    hand.tick()
    assert hand.state.state == State.RAMP_DOWN
    assert hand.state.reason == Reason.ASSIST_DWELL
    assert hand.state.trips == ()  # a long assist is no fault of the bridge
    for _ in range(10):
        hand.beat(*hand.act())
    assert hand.state.state == State.FOLLOW
    assert hand.state.armed
    for _ in range(3):
        hand.beat(hand.hold())
    assert hand.state.state == State.READY


@requirement("W6", "S6")
@pytest.mark.parametrize(("gap_ms", "latched"), [(1, False), (4, False), (5, True), (500, True)])
def test_h9_a_tick_overrun_of_five_milliseconds_latches(gap_ms: int, latched: bool) -> None:
    hand = Hand().to_assist()
    hand.now_ms += gap_ms - 1
    hand.tick()
    assert (hand.state.state == State.LATCHED) == latched
    if latched:
        assert hand.state.reason == Reason.TICK_OVERRUN
        assert hand.until_zero() <= 40


@requirement("W1")
def test_a_fault_while_ramping_down_after_hold_ends_in_follow() -> None:
    hand = Hand().to_assist()
    hand.tick(hand.hold())
    hand.tick(Received(frames.ACT_CMD, bytes(8)), Received(frames.ACT_CMD, bytes(8)))
    assert hand.state.state == State.RAMP_DOWN
    assert hand.state.ramp_fault
    assert hand.state.reason == Reason.E2E_INVALID
    assert len(hand.state.trips) == 1
    hand.until_zero()
    hand.tick()
    assert hand.state.state == State.FOLLOW
    assert hand.state.neutral == 0


@requirement("S5")
def test_after_a_fault_the_way_back_needs_three_holds() -> None:
    hand = Hand().to_assist()
    hand.run(200)
    assert hand.state.state == State.FOLLOW
    hand.arm()
    for _ in range(3):
        hand.beat(*hand.act())
    assert hand.state.state == State.FOLLOW
    for _ in range(5):
        hand.beat(hand.hold())
    assert hand.state.state == State.READY


@requirement("S6")
@pytest.mark.parametrize(("apart_ms", "latched"), [(1000, True), (29_400, True), (30_600, False)])
def test_h7_three_trips_within_a_minute_latch(apart_ms: int, latched: bool) -> None:
    hand = Hand().to_ready()
    next_ms = 0
    for _ in range(3):
        while hand.state.state != State.READY or hand.now_ms < next_ms:
            if not hand.state.armed:
                hand.arm()
            hand.beat(hand.hold())
        next_ms = hand.now_ms + apart_ms
        hand.tick(hand.heartbeat())
        hand.run(100)
        hand.tick(hand.heartbeat())
    assert (hand.state.state == State.LATCHED) == latched
    if latched:
        assert hand.state.reason == Reason.REPEATED_TRIPS


@requirement("S6")
def test_trips_in_one_incident_count_once() -> None:
    hand = Hand().to_assist()
    hand.run(400)  # command, then heartbeat
    assert hand.state.state == State.FOLLOW
    assert len(hand.state.trips) == 1
    assert not hand.state.armed


@requirement("S6")
def test_the_second_bus_off_in_ten_seconds_latches() -> None:
    hand = Hand().to_assist()
    hand.tick(bus_off=True)
    assert hand.state.state == State.RAMP_DOWN
    assert hand.state.reason == Reason.BUS_OFF
    assert not hand.state.armed
    hand.run(100, bus_off=True)  # the same bus-off is not counted again
    assert hand.state.state == State.FOLLOW
    assert hand.count(25) == 1
    hand.run(9_800)
    hand.tick(bus_off=True)
    assert hand.state.state == State.LATCHED
    assert hand.state.reason == Reason.REPEATED_BUS_OFF
    assert hand.count(25) == 2


@requirement("S8")
def test_bus_offs_ten_seconds_apart_recover_alone() -> None:
    hand = Hand().to_ready()
    hand.tick(bus_off=True)
    assert hand.state.state == State.FOLLOW
    hand.run(9_999)
    hand.tick(bus_off=True)
    assert hand.state.state == State.FOLLOW


@requirement("P1")
def test_limits_are_the_numbers_of_the_contract() -> None:
    assert (
        watchdogs.COMMAND_LIMIT_MS,
        watchdogs.AUTH_LIMIT_MS,
        watchdogs.ECHO_LIMIT_MS,
        watchdogs.SENSING_LIMIT_MS,
        watchdogs.HEARTBEAT_LIMIT_MS,
        watchdogs.TICK_LIMIT_MS,
        watchdogs.DWELL_LIMIT_MS,
        watchdogs.TRIP_LIMIT,
        watchdogs.TRIP_WINDOW_MS,
        watchdogs.MAC_FAILURE_LIMIT,
        watchdogs.BUS_OFF_LIMIT,
        watchdogs.BUS_OFF_WINDOW_MS,
        watchdogs.NEUTRAL_HOLDS,
    ) == (100, 10, 100, 150, 250, 5, 10_000, 3, 60_000, 3, 2, 10_000, 3)


def test_watchdog_questions_at_their_edges() -> None:
    assert not watchdogs.expired(10, 109, 100)
    assert watchdogs.expired(10, 110, 100)
    assert watchdogs.fresh(10, 20, 10)
    assert watchdogs.fresh(10, 10, 10)
    assert not watchdogs.fresh(10, 21, 10)
    assert not watchdogs.fresh(11, 10, 10)
    assert watchdogs.crowded((0, 50, 99), 99, 3, 100)
    assert not watchdogs.crowded((0, 50, 99), 100, 3, 100)
    assert not watchdogs.crowded((0, 50), 50, 3, 100)
    assert watchdogs.remember((1, 2, 3), 4, 3) == (2, 3, 4)
    assert watchdogs.remember((), 4, 3) == (4,)


@requirement("S10")
@pytest.mark.parametrize(
    ("angle", "second", "previous", "velocity", "bad"),
    [
        (0, 0, 0, 0, False),
        (10_000, 13_000, 10_000, 0, False),
        (10_000, 13_001, 10_000, 0, True),
        (13_001, 10_000, 13_001, 0, True),
        (13_000, 10_000, 13_000, 0, False),
        (-40_000, -40_000, -40_000, 0, False),
        (-40_001, -40_001, -40_001, 0, True),
        (200_000, 200_000, 200_000, 0, False),
        (200_001, 200_001, 200_001, 0, True),
        (10_000, 10_000, 5_000, 5_000_000, False),
        (10_001, 10_001, 5_000, 5_001_000, True),
        (5_000, 5_000, 10_001, -5_001_000, True),
        (5_000, 5_000, 10_000, -5_000_000, False),
        (10_000, 10_000, 10_000, 30_000, False),
        (10_000, 10_000, 10_000, 30_001, True),
        (10_000, 10_000, 10_000, -30_000, False),
        (10_000, 10_000, 10_000, -30_001, True),
        (10_100, 10_100, 10_000, 100_000, False),
        (10_100, 10_100, 10_000, 0, True),
        (10_100, 10_100, 10_000, 69_999, True),
        (10_100, 10_100, 10_000, 130_000, False),
        (10_000, 10_000, 5_000, 5_030_000, False),
        (10_000, 10_000, 5_000, 5_030_001, True),
        (10_000, 10_000, 5_000, 4_969_999, True),
    ],
)
def test_h4_implausible_sensors(angle: int, second: int, previous: int, velocity: int, bad: bool) -> None:
    assert watchdogs.implausible(angle, second, previous, velocity) is bad


@requirement("S10")
@pytest.mark.parametrize(
    ("user", "previous", "bad"),
    [
        (20_000_000, 20_000_000, False),
        (20_000_001, 20_000_000, True),
        (-20_000_000, -20_000_000, False),
        (-20_000_001, -20_000_000, True),
        (5_000_000, 0, False),
        (5_000_001, 0, True),
        (-2_000_000, 3_000_000, False),
        (-2_000_001, 3_000_000, True),
    ],
)
def test_h4_a_torque_no_wearer_has(user: int, previous: int, bad: bool) -> None:
    assert watchdogs.impossible(user, previous) is bad


@requirement("S10", "W8")
def test_doubt_leaks_and_is_not_cleared_by_one_good_tick() -> None:
    assert [watchdogs.leaked(doubt, True, 8, 24) for doubt in (0, 8, 16, 24, 32)] == [8, 16, 24, 32, 32]
    assert [watchdogs.leaked(doubt, False, 8, 24) for doubt in (24, 1, 0)] == [23, 0, 0]
    assert (watchdogs.SENSOR_RISE, watchdogs.SENSOR_DOUBT) == (8, 24)
    assert (watchdogs.TRACKING_RISE, watchdogs.TRACKING_DOUBT) == (4, 80)
    doubt, worst = 0, 0
    for tick in range(3000):  # one tick in nine may be bad for ever
        doubt = watchdogs.leaked(doubt, tick % 9 == 0, watchdogs.SENSOR_RISE, watchdogs.SENSOR_DOUBT)
        worst = max(worst, doubt)
    assert worst == watchdogs.SENSOR_RISE


@requirement("S9")
@pytest.mark.parametrize(
    "changes",
    [
        {"angle_low_mdeg": -20_001},
        {"angle_low_mdeg": 145_000},
        {"angle_high_mdeg": 160_001},
        {"speed_limit_mdeg_s": 0},
        {"speed_limit_mdeg_s": 600_001},
        {"tracking_limit_unm": 0},
        {"tracking_limit_unm": 1_000_001},
    ],
)
def test_no_configuration_switches_a_watchdog_off(changes: dict[str, int]) -> None:
    with pytest.raises(ValueError, match=next(iter(changes))):
        watchdogs.Limits(**changes)


@requirement("S9")
def test_limits_allow_their_bounds() -> None:
    assert watchdogs.Limits(-20_000, 160_000, 600_000, 1_000_000).speed_limit_mdeg_s == 600_000
    assert watchdogs.Limits(0, 1, 1, 1).tracking_limit_unm == 1
    assert watchdogs.Limits() == watchdogs.Limits(0, 145_000, 400_000, 600_000)


@requirement("W2")
def test_a_waiting_act_is_forgotten_when_the_session_goes() -> None:
    hand = Hand().to_ready()
    hand.tick(hand.act_cmd(frames.GATE_ACT, TAKE))
    assert hand.state.pending is not None
    hand.tick(bus_off=True)
    assert hand.state.pending is None
    hand.run(12)
    assert hand.count(Reject.AUTH_MISSING) == 0


@requirement("T2", "T4")
@pytest.mark.parametrize("after_ms", [1, 20, 36])
def test_h2_a_latch_during_a_ramp_does_not_prolong_it(after_ms: int) -> None:
    hand = Hand().to_assist()
    hand.tick(hand.hold())
    held_ms = hand.now_ms
    hand.run(after_ms - 1)
    hand.tick(Received(frames.CTRL_HB, b""))
    assert hand.state.state == State.LATCHED
    hand.until_zero()
    assert hand.now_ms - held_ms == 39


@requirement("T3")
@pytest.mark.parametrize("after_ms", [1, 20, 36])
def test_h2_a_stop_during_a_ramp_takes_over_from_where_it_is(after_ms: int) -> None:
    hand = Hand().to_assist()
    hand.tick(hand.hold())
    hand.run(after_ms - 1)
    before = hand.outputs.assist_unm
    hand.tick(Received(frames.STOP, b""))
    assert abs(hand.outputs.assist_unm) <= abs(before)
    assert hand.until_zero() <= 9


@requirement("S6")
@pytest.mark.parametrize(("age_ms", "latched"), [(59_999, True), (60_000, False)])
def test_the_minute_of_the_trips_to_the_millisecond(age_ms: int, latched: bool) -> None:
    hand = Hand().to_ready()
    trip_ms = hand.state.command_ms + 100
    hand.state.trips = (trip_ms - age_ms, trip_ms - 1000)
    while hand.now_ms < trip_ms:
        hand.tick()
    assert (hand.state.state == State.LATCHED) == latched


@requirement("S6")
@pytest.mark.parametrize(("age_ms", "latched"), [(9_999, True), (10_000, False)])
def test_the_ten_seconds_of_bus_offs_to_the_millisecond(age_ms: int, latched: bool) -> None:
    hand = Hand().to_ready()
    hand.state.bus_offs = (hand.now_ms + 1 - age_ms,)
    hand.tick(bus_off=True)
    assert (hand.state.state == State.LATCHED) == latched
