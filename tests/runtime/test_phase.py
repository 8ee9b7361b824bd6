"""runtime.phase: the tick keeps its schedule, locks to a camera of its own rate, and counts what it misses."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.limits import MS, TICK_GRACE_NS, TICK_NS
from hilbridge.runtime.phase import locks_to, next_tick


def test_free_running_ticks_keep_their_schedule() -> None:
    assert next_tick(0, 1 * MS, None).due_ns == TICK_NS
    late = next_tick(0, 39 * MS, None)
    assert (late.due_ns, late.missed) == (TICK_NS, 0)


@pytest.mark.parametrize(("now_ms", "due_ms", "missed"), [(40, 80, 1), (79, 80, 1), (80, 120, 2), (1000, 1040, 25)])
def test_missed_ticks_are_skipped_and_counted(now_ms: int, due_ms: int, missed: int) -> None:
    plan = next_tick(0, now_ms * MS, None)
    assert (plan.due_ns, plan.missed) == (due_ms * MS, missed)


@given(st.integers(0, TICK_NS - 1), st.integers(-4, 4))
def test_the_phase_locks_to_a_25_fps_camera_from_any_start(offset_ns: int, drift_us: int) -> None:
    camera_period = TICK_NS + drift_us * 1000
    due, first = 0, offset_ns
    for _ in range(400):
        wait = (due - first) % camera_period
        plan = next_tick(due, due, due - wait)
        assert abs(plan.due_ns - due - TICK_NS) <= 2 * MS
        due = plan.due_ns
    assert (due - first) % camera_period <= 4 * MS


@given(st.integers(0, TICK_NS + TICK_GRACE_NS))
def test_the_first_features_set_the_phase_at_once(offset_ns: int) -> None:
    """Also those that the tick had to wait for."""
    due, first_ready = TICK_NS, offset_ns
    plan = next_tick(due, max(due, first_ready), first_ready, first=True)
    assert (plan.due_ns - first_ready) % TICK_NS == 1 * MS
    assert TICK_NS // 2 <= plan.due_ns - due <= TICK_GRACE_NS + TICK_NS + 1 * MS


def test_ticks_missed_before_the_first_features_are_counted() -> None:
    plan = next_tick(0, 500 * MS, 490 * MS, first=True)
    assert (plan.due_ns, plan.missed) == (531 * MS, 12)
    assert next_tick(0, TICK_GRACE_NS, TICK_GRACE_NS, first=True).missed == 0


def test_a_picture_that_was_waited_for_moves_the_phase_little() -> None:
    plan = next_tick(0, 20 * MS, 19 * MS)
    assert TICK_NS < plan.due_ns <= TICK_NS + MS // 2


@given(st.integers(0, 10**12), st.integers(0, 10**10), st.one_of(st.none(), st.integers(0, 10**9)))
def test_the_next_tick_is_always_in_the_future_and_soon(due: int, late: int, wait: int | None) -> None:
    plan = next_tick(due, due + late, None if wait is None else due + late - wait)
    assert due + late < plan.due_ns <= due + late + TICK_NS + 2 * MS
    assert plan.missed >= 0


@pytest.mark.parametrize(("fps", "locks"), [(25.0, True), (24.6, True), (25.4, True), (30.0, False), (24.0, False)])
def test_only_a_25_fps_camera_is_locked_to(fps: float, locks: bool) -> None:
    assert locks_to(fps) is locks
