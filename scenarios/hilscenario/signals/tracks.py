"""Records changes of named signals while a run goes on."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping

from hilscenario.signals.trace import Trace, sample_and_hold

Value = float | str | bool
_UNHEARD = object()  # equals no value


class Tracks:
    """Signals by name, each a list of (time in ms, value) that only grows when the value changes."""

    def __init__(self) -> None:
        self.now: dict[str, Value] = {}
        self.events: defaultdict[str, list[tuple[float, Value]]] = defaultdict(list)
        self.version = 0

    def put(self, time_ms: float, name: str, value: Value) -> None:
        """Note a value; equal ones cost a look-up."""
        if self.now.get(name, _UNHEARD) == value:
            return
        self.now[name] = value
        self.events[name].append((time_ms, value))
        self.version += 1

    def trace(self, end_ms: float, initial: Mapping[str, Value]) -> Trace:
        """All signals on a grid of 1 ms."""
        return sample_and_hold(self.events, end_ms, 1.0, initial)
