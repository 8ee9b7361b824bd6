"""The same session with every device; what is known already is not run again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

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
    assert len(told) == 3


def test_what_a_log_holds_of_the_same_gates_is_not_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[int] = []

    def session(visit: Visit, compared: Sequence[Gate]) -> list[run.Outcome]:
        ran.append(visit.person)
        return [run.Outcome(gate.name, visit, {"seconds": 1.5}) for gate in compared]

    monkeypatch.setattr(run, "session", session)
    log, one, two = tmp_path / "new" / "sessions.jsonl", Visit(1, 0, 10.0), Visit(2, 0, 10.0)
    first = run.compare([one], [Gate("a")], 1, lambda name: None, log)
    log.write_text(log.read_text() + '{"visit": {"per')  # interrupted
    both = run.compare([one, two], [Gate("a")], 1, lambda name: None, log)
    assert (ran, both[0]) == ([1, 2], first[0])
    assert run.compare([one, two], [Gate("a")], 1, lambda name: None, log) == both
    run.compare([one], [Gate("a", tau_on=0.5)], 1, lambda name: None, log)
    assert ran == [1, 2, 1]
