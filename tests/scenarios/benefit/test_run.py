"""The same session with every device; what is known already is not run again."""

from __future__ import annotations

import pytest

from hilscenario.benefit import run
from hilscenario.benefit.gates import Gate
from hilscenario.benefit.visits import Visit


def test_every_device_has_the_same_session() -> None:
    found = run.session(Visit(1, 0, 4.0), [Gate(run.CALIBRATED)])
    assert [one.device for one in found] == [run.OFF, run.CALIBRATED, run.ALWAYS]
    assert {one.sums["acting_s"] for one in found} == {found[0].sums["acting_s"]}
    off, _, always = found
    assert (off.sums["act_ticks"], off.sums["wrong_j"], off.sums["most_moved_m"]) == (0, 0.0, 0.0)
    assert always.sums["act_ticks"] > 0


def test_the_gates_have_names_of_their_own() -> None:
    names = [gate.name for gate in run.gates((0.7, 0.65))]
    assert len(set(names)) == len(names) == 5


def test_sessions_come_in_their_order(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    made = [Visit(person, 0, 10.0) for person in (3, 1, 2)]
    monkeypatch.setattr(run, "session", lambda visit, compared: [run.Outcome("one", visit, {})])
    found = run.compare(made, [], 1, told.append)
    assert [one.visit.person for one in found] == [3, 1, 2]
    assert told[0] == "person 3, session 0"
