"""Every limit of the safety contract and the pure questions asked of it (docs/protocol.md, "Numbers").

A watchdog *expires* when the limit is reached; a bound on freshness *holds* up to and including its limit. All times
are the device's own milliseconds. The numbers here are constants: no configuration switches a watchdog off.
"""

from __future__ import annotations

from dataclasses import dataclass

COMMAND_LIMIT_MS = 100
AUTH_LIMIT_MS = 10
ECHO_LIMIT_MS = 100
SENSING_LIMIT_MS = 150
HEARTBEAT_LIMIT_MS = 250
TICK_LIMIT_MS = 5
DWELL_LIMIT_MS = 10_000
TRIP_LIMIT = 3
TRIP_WINDOW_MS = 60_000
MAC_FAILURE_LIMIT = 3
BUS_OFF_LIMIT = 2
BUS_OFF_WINDOW_MS = 10_000
NEUTRAL_HOLDS = 3
CHALLENGE_LIMIT_MS = 500
DISTURBED_REST_MS = 500  # after a disturbed handshake failed: two guesses at a MAC a second, no more
CLEAR_LIMIT_MS = 30_000
# Counters that leak: a bad tick adds, a good one takes 1 off. One tick in so many may be bad for ever; more may not.
TRACKING_RISE = 4
TRACKING_DOUBT = 80  # 20 ticks in a row
SENSOR_RISE = 8
SENSOR_DOUBT = 24  # 3 ticks in a row
HEALTHY_TICKS = 500


@dataclass(frozen=True, slots=True)
class Limits:
    """What a site may set, within bounds that keep every watchdog alive (angles mdeg, speed mdeg/s, torque uN m).

    Raises ValueError naming the field and what is allowed.
    """

    angle_low_mdeg: int = 0
    angle_high_mdeg: int = 145_000
    speed_limit_mdeg_s: int = 400_000
    tracking_limit_unm: int = 600_000

    def __post_init__(self) -> None:
        if not -20_000 <= self.angle_low_mdeg < self.angle_high_mdeg <= 160_000:
            raise ValueError("angle_low_mdeg, angle_high_mdeg: must rise and stay within -20000..160000")
        if not 0 < self.speed_limit_mdeg_s <= 600_000:
            raise ValueError("speed_limit_mdeg_s: must be above 0 and at most 600000")
        if not 0 < self.tracking_limit_unm <= 1_000_000:
            raise ValueError("tracking_limit_unm: must be above 0 and at most 1000000")


def expired(fed_ms: int, now_ms: int, limit_ms: int) -> bool:
    """A deadline that was last fed at `fed_ms` is reached or past."""
    return now_ms - fed_ms >= limit_ms


def fresh(stamp_ms: int, now_ms: int, limit_ms: int) -> bool:
    """Something stamped at `stamp_ms` is not older than the limit, and not from the future."""
    return 0 <= now_ms - stamp_ms <= limit_ms


def crowded(times_ms: tuple[int, ...], now_ms: int, limit: int, window_ms: int) -> bool:
    """At least `limit` of the remembered times lie within the last `window_ms`."""
    return sum(1 for time_ms in times_ms if now_ms - time_ms < window_ms) >= limit


def remember(times_ms: tuple[int, ...], now_ms: int, limit: int) -> tuple[int, ...]:
    """The last `limit` times, this one included: a fixed table, oldest out."""
    return (*times_ms, now_ms)[-limit:]


def implausible(angle_mdeg: int, second_angle_mdeg: int, previous_mdeg: int, velocity_mdeg_s: int) -> bool:
    """What no arm can do: encoders 3 degrees apart, an angle out of this world, 5 degrees in a tick, another velocity.

    A velocity more than 30 degrees a second from what the encoder says is another one.
    """
    moved_mdeg = angle_mdeg - previous_mdeg
    return not (
        -3_000 <= angle_mdeg - second_angle_mdeg <= 3_000
        and -40_000 <= angle_mdeg <= 200_000
        and -5_000 <= moved_mdeg <= 5_000
        and -30_000 <= velocity_mdeg_s - 1_000 * moved_mdeg <= 30_000
    )


def impossible(user_unm: int, previous_unm: int) -> bool:
    """A torque no wearer has: above 20 N m, or 5 N m more in a tick, ten times what the quickest muscle does."""
    return not (-20_000_000 <= user_unm <= 20_000_000 and -5_000_000 <= user_unm - previous_unm <= 5_000_000)


def leaked(doubt: int, bad: bool, rise: int, limit: int) -> int:
    """A leaky counter after one more tick. It stops one rise above its limit, so that it comes down again soon."""
    return min(doubt + rise, limit + rise) if bad else max(0, doubt - 1)
