"""hilscenario.lockstep.clock: everything comes in its order, the device's tick among the rest."""

from __future__ import annotations

import pytest

from hilscenario.lockstep.clock import WorldClock

MS = 1_000_000


def test_the_devices_tick_takes_its_turn_among_those_of_one_time() -> None:
    """First come, first served: what was planned before the last tick ended comes before it, what came later after."""
    clock, said = WorldClock(), list[str]()
    clock.at(3 * MS, lambda: said.append("early"))
    clock.at(2 * MS + 1, lambda: clock.at(3 * MS, lambda: said.append("late")))
    clock.at(1, lambda: clock.at(0, lambda: said.append("past")))
    clock.at(5 * MS + 1, lambda: said.append("after the end"))
    clock.run(5 * MS, MS, lambda now_ns: said.append(f"tick {now_ns // MS}"))
    assert said == ["past", "tick 1", "tick 2", "early", "tick 3", "late", "tick 4", "tick 5"]
    assert clock.now_ns() == 5 * MS


def test_ticks_at_once_end_before_whatever_else_there_is() -> None:
    """Before a planned call, before what is due elsewhere, with the end; a tick that is planned against stands alone."""
    clock, made = WorldClock(), list[tuple[int, int]]()
    due_ns = [1 << 62]

    def tick(now_ns: int) -> None:
        most = clock.ticks_alone(due_ns[0])
        made.append((now_ns // MS, most))
        assert clock.pass_ticks(most) == now_ns + (most - 1) * MS

    clock.at(4 * MS, lambda: None)  # at the time of a tick: it comes first, since it was planned first
    clock.at(6 * MS + 1, lambda: due_ns.__setitem__(0, 9 * MS))
    clock.run(12 * MS, MS, tick)
    assert made == [(1, 3), (4, 3), (7, 2), (9, 1), (10, 1), (11, 1), (12, 1)]


def test_nobody_waits_on_this_clock() -> None:
    with pytest.raises(AssertionError, match="never waits"):
        WorldClock().wait_until(1)
