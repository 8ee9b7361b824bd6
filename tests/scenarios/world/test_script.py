"""hilscenario.world.script: faults begin, repeat and end when they should, whoever carries them out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hilscenario.signals.tracks import Value
from hilscenario.world.agenda import Agenda
from hilscenario.world.fault_board import Active, FaultBoard
from hilscenario.world.script import Player
from tests.scenarios.made import scenario

MS = 1_000_000


class Stage(Agenda):
    """A clock that jumps to what comes next, up to `late_ns` late, and an executor that writes down what it is told."""

    def __init__(self, *steps: dict[str, Any], late_ns: int = 0) -> None:
        super().__init__()
        self.time_ns, self._late_ns = 0, late_ns
        self.said: list[str] = []
        self.told: list[tuple[int, bool, str]] = []
        self.board = FaultBoard(scenario(duration="10 s", steps=list(steps)).steps)
        self.player = Player(self.board, self, self)
        self.player.start()

    def now_ns(self) -> int:
        return self.time_ns

    def run(self, until_ms: int) -> list[str]:
        while (next_ns := self.next_ns) is not None and next_ns <= until_ms * MS:
            self.time_ns = max(self.time_ns, next_ns + self._late_ns)
            do = self.take_due(self.time_ns)
            assert do is not None
            do()
        self.time_ns = max(self.time_ns, until_ms * MS)
        return self.said

    def look(self, at_ms: int, **signals: Value) -> None:
        self.player.look(at_ms * MS, {name.replace("_", ".", 1): value for name, value in signals.items()})

    def begin(self, number: int, active: Active, now_ns: int) -> None:
        assert self.board.get(active.step.fault) is active
        self.said.append(f"{now_ns / MS:g} +{active.step.fault}")

    def end(self, number: int, active: Active, now_ns: int) -> None:
        assert self.board.get(active.step.fault) is not active
        self.said.append(f"{now_ns / MS:g} -{active.step.fault}")

    def tell(self, now_ns: int, signals: Mapping[str, bool], text: str) -> None:
        self.told.append((now_ns // MS, signals["fault.any"], text))


def test_a_fault_begins_at_its_time_and_ends_after_its_length() -> None:
    stage = Stage({"fault": "gaze.off", "at": "20 ms", "for": "30 ms"}, {"fault": "bus.cut", "at": "10 ms"})
    assert stage.run(9000) == ["10 +bus.cut", "20 +gaze.off", "50 -gaze.off"]
    assert stage.told == [
        (10, True, "fault: bus.cut begins"),
        (20, True, "fault: gaze.off begins"),
        (50, True, "fault: gaze.off ends"),
    ]


def test_an_instant_is_seen_for_a_millisecond() -> None:
    stage = Stage({"fault": "bridge.kill", "at": "20 ms"})
    assert stage.run(9000) == ["20 +bridge.kill", "21 -bridge.kill"]
    assert [(at_ms, any_) for at_ms, any_, _ in stage.told] == [(20, True), (21, False)]


def test_a_repeated_fault_keeps_its_own_times_though_each_call_comes_late() -> None:
    step = {"fault": "gaze.off", "at": "10 ms", "every": "50 ms", "for": "20 ms"}
    assert Stage(step).run(120) == [
        "10 +gaze.off", "30 -gaze.off", "60 +gaze.off", "80 -gaze.off", "110 +gaze.off",
    ]  # fmt: skip
    late = Stage(step, late_ns=7 * MS)
    begins = [said for said in late.run(120) if "+" in said]
    assert begins == ["17 +gaze.off", "67 +gaze.off", "117 +gaze.off"]
    assert late.board.all[0].injections == 3


def test_a_condition_injects_once_so_long_after_it_first_holds() -> None:
    stage = Stage({"fault": "gaze.off", "when": "device.state == Assist and gate.act", "after": "30 ms"})
    stage.look(5, device_state="Assist")  # gate.act has no value yet
    stage.look(6, device_state="Ready", gate_act=True)
    assert stage.player.waiting == {0}
    stage.look(7, device_state="Assist", gate_act=True)
    assert not stage.player.waiting
    stage.look(8, device_state="Assist", gate_act=True)
    assert stage.run(9000) == ["37 +gaze.off"]
