"""Plays a scenario's steps: injects each fault when it is due, repeats it, ends it. For virtual time and for live runs.

The player knows times and conditions only. Its executor makes a fault happen and makes it stop.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Protocol

from hilscenario.format.vocabulary import fault_kind
from hilscenario.signals.stl import holds_now, signal_names
from hilscenario.signals.tracks import Value
from hilscenario.world.fault_board import Active, FaultBoard

_INSTANT_NS = 1_000_000


class Clock(Protocol):
    """The scenario's time, in ns from its 0, and calls that wait for theirs."""

    def now_ns(self) -> int: ...

    def at(self, when_ns: int, do: Callable[[], None]) -> None: ...


class Executor(Protocol):
    """What makes faults happen. `number` is the step's place in the scenario."""

    def begin(self, number: int, active: Active, now_ns: int) -> None: ...

    def end(self, number: int, active: Active, now_ns: int) -> None: ...

    def tell(self, now_ns: int, signals: Mapping[str, bool], text: str) -> None:
        """Which faults are under way has changed: signals by name, and the same in words. Comes before begin and end."""


class Player:
    """Plays the steps of one board. `waiting` has the steps whose condition has not held yet."""

    def __init__(self, board: FaultBoard, clock: Clock, executor: Executor) -> None:
        self._board, self._clock, self._executor = board, clock, executor
        self._conditions = {number: step.when for number, step in enumerate(board.steps) if step.when is not None}
        self._names = {number: signal_names(condition) for number, condition in self._conditions.items()}
        self.waiting = set(self._conditions)

    def start(self) -> None:
        """Plan the steps that have a time."""
        for number, step in enumerate(self._board.steps):
            if step.at is not None:
                self._clock.at(step.at, partial(self._inject, number))

    def look(self, now_ns: int, signals: Mapping[str, Value]) -> None:
        """Plan the steps whose condition holds on these signals. A signal that has no value yet fulfils nothing."""
        for number in sorted(self.waiting):
            names = self._names[number]
            if names <= signals.keys() and holds_now(self._conditions[number], {name: signals[name] for name in names}):
                self.waiting.discard(number)
                self._clock.at(now_ns + self._board.steps[number].after, partial(self._inject, number))

    def _inject(self, number: int) -> None:
        now_ns, step = self._clock.now_ns(), self._board.steps[number]
        active = self._board.inject(number, now_ns)
        self._executor.tell(now_ns, self._board.signals(), f"fault: {step.fault} begins")
        self._executor.begin(number, active, now_ns)
        if step.for_ is not None:
            self._clock.at(now_ns + step.for_, partial(self._finish, number))
        elif fault_kind(step.fault).instant:
            # An instant is over at once. Its signal stays for a millisecond, so that expectations can see it.
            self._clock.at(now_ns + _INSTANT_NS, partial(self._finish, number))
        if step.every is not None:
            # From the step's own time on: a live run that is late once is not late ever after.
            self._clock.at((step.at or 0) + active.injections * step.every, partial(self._inject, number))

    def _finish(self, number: int) -> None:
        now_ns = self._clock.now_ns()
        active = self._board.end(number)
        self._executor.tell(now_ns, self._board.signals(), f"fault: {active.step.fault} ends")
        self._executor.end(number, active, now_ns)
