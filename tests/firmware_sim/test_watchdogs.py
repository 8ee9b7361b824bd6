"""The limits of the contract and the pure questions asked of them."""

from __future__ import annotations

import pytest

from firmware_sim import watchdogs

requirement = pytest.mark.requirement


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
