"""hilscenario.world.agenda: calls come by time, and of one time in the order of planning."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from hilscenario.world.agenda import Agenda


@given(st.lists(st.integers(0, 5)))
def test_calls_come_by_time_and_then_as_they_were_planned(times_ns: list[int]) -> None:
    agenda, came = Agenda(), list[tuple[int, int]]()
    for number, when_ns in enumerate(times_ns):
        agenda.at(when_ns, lambda when_ns=when_ns, number=number: came.append((when_ns, number)))  # type: ignore[misc]
    assert agenda.next_ns == min(times_ns, default=None)
    while (do := agenda.take_due(5)) is not None:
        do()
    assert came == sorted(came)
    assert len(came) == len(times_ns)


def test_what_is_not_due_waits() -> None:
    agenda = Agenda()
    agenda.at(10, lambda: None)
    assert agenda.take_due(9) is None
    assert agenda.next_ns == 10
    assert agenda.take_due(10) is not None
    assert agenda.next_ns is None
