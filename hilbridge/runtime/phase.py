"""The phase of the 25 Hz tick against the camera, pure.

A free-running tick waits for up to a frame before it sees a picture. Where the camera itself runs at the tick's rate,
the tick can be steered to come just after each picture's features are ready, which takes that wait out of the latency.
A picture that takes longer than usual is then waited for, within bounds, rather than missed by a whole period.
"""

from __future__ import annotations

from dataclasses import dataclass

from hilbridge.limits import MS, TICK_NS

_TARGET_WAIT_NS = 1 * MS  # about the jitter of a steady detector; a tick that comes before its picture waits for it
_GAIN = 0.25
_MAX_STEER_NS = 2 * MS
_RATE_TOLERANCE = 0.02


def locks_to(camera_fps: float) -> bool:
    """True where the camera's rate is the tick's within 2 %, so that a fixed phase exists."""
    return abs(camera_fps * TICK_NS / 1e9 - 1.0) <= _RATE_TOLERANCE


@dataclass(frozen=True, slots=True)
class TickPlan:
    """When the next tick is due and how many ticks were missed since the last one."""

    due_ns: int
    missed: int


def next_tick(due_ns: int, now_ns: int, ready_ns: int | None, *, first: bool = False) -> TickPlan:
    """Plan the tick after the one that was due at `due_ns` and ran at `now_ns`.

    `ready_ns` is when the newest features were ready (None: no lock, or no features). Steering is at most 2 ms a tick, so
    the tick's own rate stays within 5 % of 25 Hz; only the `first` features of a run set the phase at once (20 to 65 ms
    to the next tick). Ticks that are already over are skipped and counted, never made up for.
    """
    steer = 0
    if ready_ns is not None:
        error = due_ns - ready_ns - _TARGET_WAIT_NS
        if error > TICK_NS // 2:  # nearer to a picture that is still to come
            error = (error + TICK_NS // 2) % TICK_NS - TICK_NS // 2
        # One late picture says little of the next, so it counts as one that came just in time.
        gentle = int(-_GAIN * max(error, -_TARGET_WAIT_NS))
        steer = -error if first else max(-_MAX_STEER_NS, min(_MAX_STEER_NS, gentle))
    planned = due_ns + TICK_NS + steer
    if planned > now_ns:  # where first features came long after the tick was due, the periods between are missed, too
        return TickPlan(planned, max(0, (planned - due_ns) // TICK_NS - 1))
    missed = (now_ns - planned) // TICK_NS + 1
    return TickPlan(planned + missed * TICK_NS, missed)
