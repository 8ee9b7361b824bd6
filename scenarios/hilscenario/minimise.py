"""Shrinks a failing scenario: fewer faults first (delta debugging, Zeller 1999), then shorter, then simpler.

A candidate counts only where it fails in the same way: one violation of the original's is chosen, the first of its
expectations that fails or the one that was asked for, and every smaller scenario violates that one again.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hilbridge.errors import InputError
from hilscenario.format.files import dump_scenario
from hilscenario.format.schema import Scenario, Step
from hilscenario.format.vocabulary import FAULTS
from hilscenario.lockstep.run import run_scenario

_SHORTEST_NS = 500_000_000


def violations(scenario: Scenario) -> frozenset[str]:
    """Texts of the expectations that the scenario violates. A fault without effect is no violation here."""
    result = run_scenario(scenario).result
    return frozenset(judgement.text for judgement in result.judgements if not judgement.holds)


def minimise_scenario(
    scenario: Scenario,
    fails: Callable[[Scenario], frozenset[str]] = violations,
    progress: Callable[[str], None] = lambda text: None,
    keep: str | None = None,
) -> Scenario:
    """The smallest scenario found that still violates the same expectation. Raises InputError when there is none.

    `keep`: the expectation to keep, or a part of its text; without it the first in order of their texts.
    """
    failing = sorted(fails(scenario))
    if not failing:
        raise InputError(f"{scenario.name}: does not fail, so there is nothing to minimise")
    chosen = [text for text in failing if keep is None or keep in text]
    if not chosen:
        raise InputError(f"--keep {keep}: is not violated; violated are {', '.join(f'`{text}`' for text in failing)}")
    wanted = chosen[0]
    progress(f"keeps the violation of `{wanted}`{_besides(failing, wanted)}")
    tried: dict[str, bool] = {}

    def still(candidate: Scenario) -> bool:
        key = dump_scenario(candidate)
        if key not in tried:
            tried[key] = wanted in fails(candidate)
        return tried[key]

    small = _fewer_steps(scenario, still)
    progress(f"{len(small.steps)} of {len(scenario.steps)} faults left after {len(tried)} runs")
    small = _shorter(small, still)
    small = _simpler(small, still)
    progress(f"{small.duration / 1e9:g} s long after {len(tried)} runs")
    return small


def _besides(failing: list[str], wanted: str) -> str:
    others = [f"`{text}`" for text in failing if text != wanted]
    return f", not of {', '.join(others)} (--keep chooses)" if others else ""


def _fewer_steps(scenario: Scenario, still: Callable[[Scenario], bool]) -> Scenario:
    """ddmin over the steps."""
    parts = 2
    while scenario.steps:
        steps = scenario.steps
        size = max(1, len(steps) // parts)
        for start in range(0, len(steps), size):
            candidate = scenario.model_copy(update={"steps": steps[:start] + steps[start + size :]})
            if still(candidate):
                scenario, parts = candidate, max(2, parts - 1)
                break
        else:
            if size == 1:
                return scenario
            parts = min(len(steps), 2 * parts)
    return scenario


def _shorter(scenario: Scenario, still: Callable[[Scenario], bool]) -> Scenario:
    """Halve the time that can be spared, down to a tenth of a second."""
    low = max([_SHORTEST_NS, *(step.at + 1 for step in scenario.steps if step.at is not None)])
    high = scenario.duration
    while high - low > 100_000_000:
        middle = (low + high) // 2 // 1_000_000 * 1_000_000
        if still(scenario.model_copy(update={"duration": middle})):
            high = middle
        else:
            low = middle
    return scenario.model_copy(update={"duration": high})


def _simpler(scenario: Scenario, still: Callable[[Scenario], bool]) -> Scenario:
    """Default options, no repetition, whole tenths of a second; parts of the scenario back to their defaults."""
    for number in range(len(scenario.steps)):
        for change in _simplifications(scenario.steps[number]):
            steps = list(scenario.steps)
            steps[number] = steps[number].model_copy(update=change)
            candidate = scenario.model_copy(update={"steps": tuple(steps)})
            if steps[number] != scenario.steps[number] and still(candidate):
                scenario = candidate
    for part in ("bus", "device", "wearer"):
        candidate = scenario.model_copy(update={part: Scenario.model_fields[part].default})
        if candidate != scenario and still(candidate):
            scenario = candidate
    return scenario


def _simplifications(step: Step) -> list[dict[str, Any]]:
    defaults = {name: option.default for name, option in FAULTS[step.fault].options.items()}
    changes: list[dict[str, Any]] = [{"options": defaults}, {"every": None}]
    if step.at is not None:
        changes.append({"at": round(step.at / 1e8) * 100_000_000})
    if step.after:
        changes += [{"after": 0}, {"after": round(step.after / 1e8) * 100_000_000}]
    if step.for_ is not None:
        changes.append({"for_": max(1, round(step.for_ / 1e8)) * 100_000_000})
    return changes
