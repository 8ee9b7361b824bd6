"""What a case is, and what several of them do."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from hilbridge.conformance.findings import demand
from hilbridge.conformance.tester import ByHand

Run = Callable[[ByHand], str]


class Case(NamedTuple):
    """`run` returns what was seen, or raises Broken or Unshown."""

    name: str
    claim: str
    run: Run


def stays(tester: ByHand, states: tuple[str, ...], milliseconds: float, after: str) -> None:
    """Let time go by; Broken where a status told any other state."""
    began_ns = tester.line.now_ns()
    tester.run(milliseconds)
    for heard in tester.hearing.since(began_ns):
        if heard.name == "CTRL_STATUS":
            state = heard.signals["State"]
            demand(state in states, f"{state} ({heard.signals['Reason']}) after {after}")


def risen(before: dict[str, int], after: dict[str, int], name: str, by: int, what: str) -> None:
    """Broken unless a counter has grown by so many."""
    grown = after[name] - before[name]
    demand(grown == by, f"{name} grew by {grown}, not {by}, after {what}")
