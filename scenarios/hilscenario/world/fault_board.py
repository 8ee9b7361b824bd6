"""Which faults are under way, and how often each took effect. Whoever injects a fault asks here."""

from __future__ import annotations

from dataclasses import dataclass, field

from hilbridge.rows import FaultRow
from hilscenario.format.schema import Step

FOREVER_NS = 1 << 62


@dataclass(slots=True, eq=False)  # two steps may be the same fault
class Active:
    """One step of the scenario while it is under way; `effects` counts what it really did, over all its injections."""

    step: Step
    from_ns: int = 0
    until_ns: int = FOREVER_NS
    effects: int = 0
    injections: int = 0

    def took_effect(self, times: int = 1) -> None:
        """Count what the fault did."""
        self.effects += times

    def __getitem__(self, option: str) -> float:
        return self.step.options[option]


def fault_row(number: int, active: Active, now_ns: int, *, begins: bool) -> FaultRow:
    """A fault of step `number` as a row."""
    step = active.step
    target = step.fault.partition(".")[0]
    return FaultRow(now_ns, step.fault, target, begins, number, active.effects, dict(step.options))


@dataclass(slots=True)
class FaultBoard:
    """All steps of one scenario. `get` is asked very often and costs one dictionary look-up."""

    steps: tuple[Step, ...]
    all: list[Active] = field(init=False)
    quiet: bool = field(init=False, default=True)  # nothing is under way: the usual case, asked for first
    # Tuples, replaced and never changed: live, sensor threads ask while the loop injects.
    _under_way: dict[str, tuple[Active, ...]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self.all = [Active(step) for step in self.steps]

    def get(self, fault: str) -> Active | None:
        """The fault of that name under way that was injected last, or None."""
        found = self._under_way.get(fault)
        return found[-1] if found else None

    def inject(self, number: int, now_ns: int) -> Active:
        """Begin step `number`; its end is the caller's to schedule."""
        active = self.all[number]
        active.injections += 1
        active.from_ns = now_ns
        active.until_ns = FOREVER_NS if active.step.for_ is None else now_ns + active.step.for_
        self._under_way[active.step.fault] = (*self._under_way.get(active.step.fault, ()), active)
        self.quiet = False
        return active

    def end(self, number: int) -> Active:
        """End step `number`."""
        active = self.all[number]
        under_way = list(self._under_way.get(active.step.fault, ()))
        if active in under_way:
            under_way.remove(active)
        if under_way:
            self._under_way[active.step.fault] = tuple(under_way)
        else:
            self._under_way.pop(active.step.fault, None)
        self.quiet = not self._under_way
        return active

    def signals(self) -> dict[str, bool]:
        """`fault.NAME` of every step, and `fault.any`."""
        named = {f"fault.{step.fault}": step.fault in self._under_way for step in self.steps}
        return {**named, "fault.any": bool(self._under_way)}

    def effects(self) -> list[tuple[str, int, int]]:
        """(fault, injections, effects) of every step, in the order of the file."""
        return [(active.step.fault, active.injections, active.effects) for active in self.all]
