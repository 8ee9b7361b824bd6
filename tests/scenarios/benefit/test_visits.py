"""Who comes: a person keeps their tremor over sessions, and no two sessions are one."""

from __future__ import annotations

import pytest

from firmware_sim.plant.nerves import CONTROLS
from firmware_sim.plant.tremors import KINDS
from hilscenario.benefit.visits import (
    CONTROL_OF,
    MOST_SESSIONS,
    Visit,
    person_of,
    plan_of,
    tremor_of,
    visits,
    wearer_of,
)


def test_every_session_has_a_seed_of_its_own_and_both_kinds_come() -> None:
    made = visits(6, 3, 30.0)
    assert len({visit.seed for visit in made}) == 18
    assert {visit.kind for visit in made} == set(CONTROL_OF) <= set(KINDS)
    assert {visit.control for visit in made} <= set(CONTROLS)
    assert Visit(0, MOST_SESSIONS - 1).seed < Visit(1, 0).seed


def test_the_tremor_is_the_persons_and_its_course_the_sessions() -> None:
    one, other, somebody = (tremor_of(Visit(*which)) for which in ((2, 0), (2, 1), (4, 0)))
    assert (one.hertz, one.size_nm) == (other.hertz, other.size_nm) != (somebody.hertz, somebody.size_nm)
    assert [one.step(0.0) for _ in range(5)] != [other.step(0.0) for _ in range(5)]


def test_the_same_session_is_the_same_again() -> None:
    visit = Visit(1, 0, 10.0)
    first, again = (person_of(visit) for _ in range(2))
    assert first.plan(3.3) == again.plan(3.3) == plan_of(visit)(3.3)
    assert wearer_of(visit).hands(2_000_000_000) == wearer_of(visit).hands(2_000_000_000)


@pytest.mark.parametrize("person", [0, 1])
def test_the_plan_goes_where_the_wearer_of_the_sensors_goes(person: int) -> None:
    visit = Visit(person, 0, 20.0)
    event = next(one for one in wearer_of(visit).events(20_000_000_000) if one.end_ns - one.prepare_ns > 1_500_000_000)
    still, _, _ = plan_of(visit)(event.prepare_ns * 1e-9)
    there, _, _ = plan_of(visit)(event.prepare_ns * 1e-9 + 0.9)
    assert still != there
