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


def test_nobody_waits_on_this_clock() -> None:
    with pytest.raises(AssertionError, match="never waits"):
        WorldClock().wait_until(1)
