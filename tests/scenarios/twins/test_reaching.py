"""The plan of shoulder and elbow: smooth, on the timeline's times, and where the action is."""

from __future__ import annotations

import pytest

from hilbridge.wearer.person import Wearer
from hilscenario.twins.reaching import REACH_S, REST, Leg, Reaches, first_of, pose, reaches


def test_speeds_and_accelerations_are_those_of_the_angles() -> None:
    plan = Reaches([Leg(0.5, (0.9, 1.4)), Leg(1.1, REST), Leg(3.0, (0.5, 1.9))])
    for tick in range(5, 4_500, 37):
        t_s = tick * 0.001
        if any(abs(t_s - start) < 0.002 for start in (0.5, 1.1, 2.0, 3.0, 3.9)):
            continue  # where a leg begins or ends
        before, after = plan(t_s - 1e-5), plan(t_s + 1e-5)
        for order in (0, 1):
            slope = [(b - a) / 2e-5 for a, b in zip(before[order], after[order], strict=True)]
            assert slope == pytest.approx(plan(t_s)[order + 1], abs=2e-3)


def test_the_hand_is_at_its_action_when_it_begins() -> None:
    events = Wearer(4).events(60_000_000_000)
    plan = reaches(events)
    for event in events:
        if event.start_ns - event.prepare_ns > REACH_S * 1e9:
            assert plan(event.start_ns * 1e-9)[0] == pytest.approx(pose(event))
    assert plan(0.0)[0] == REST


def test_the_first_time_of_a_verb_is_the_timelines() -> None:
    event = first_of(1, "Take")
    assert event is not None
    assert event == next(one for one in Wearer(1).events(1_200_000_000_000) if one.verb == event.verb)


def test_who_does_nothing_stays_at_rest() -> None:
    assert reaches([])(3.0) == (REST, (0.0, 0.0), (0.0, 0.0))
