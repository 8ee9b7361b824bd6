"""A run's verdicts: every expectation with its margin, every fault with its effects."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any

from hilbridge.errors import InputError
from hilscenario.format.schema import Expectation
from hilscenario.signals.stl import FormulaError, judge, signal_names
from hilscenario.signals.trace import Trace, UnknownSignal


@dataclass(frozen=True, slots=True)
class Judgement:
    """One expectation. `margin` is its robustness (at least 0 holds); `at_ms` where it came nearest to failing."""

    name: str
    text: str
    holds: bool
    margin: float
    at_ms: float | None
    value: float | None = None
    safety: bool = False
    vacuous: bool = False

    @property
    def is_vacuous_pass(self) -> bool:
        """Whether it holds only because the premise of an implication in it never held."""
        return self.holds and self.vacuous


@dataclass(frozen=True, slots=True)
class FaultCount:
    """One step: how often it was injected, and how often that took effect."""

    fault: str
    injections: int
    effects: int

    @property
    def worked(self) -> bool:
        return self.effects > 0


@dataclass(frozen=True, slots=True)
class Result:
    """The result of one run of one scenario."""

    name: str
    seed: int
    judgements: tuple[Judgement, ...]
    faults: tuple[FaultCount, ...]
    figures: dict[str, float]
    seconds: float
    cpu_s: float
    replay: str = ""
    page: str = ""
    live: bool = False  # with real processes, in real time; `cpu_s` is then the time it took
    profile: dict[str, float] = field(default_factory=dict)

    @property
    def passed(self) -> bool:
        """Every expectation holds and every fault took effect."""
        return all(judgement.holds for judgement in self.judgements) and all(fault.worked for fault in self.faults)

    @property
    def robustness(self) -> float:
        """The smallest margin of all safety expectations: how near the run came to hurting somebody."""
        return min((j.margin for j in self.judgements if j.safety), default=math.inf)

    def problems(self) -> list[str]:
        """One line for each thing that failed."""
        lines = [
            f"{j.name or j.text}: {_found(j)}" + ("" if j.at_ms is None else f" at {j.at_ms:.0f} ms")
            for j in self.judgements
            if not j.holds
        ]
        return lines + [
            f"fault {f.fault} never took effect ({f.injections} injections)" for f in self.faults if not f.worked
        ]

    def as_json(self) -> dict[str, Any]:
        """For machines: infinities and NaN as null."""
        row = asdict(self)
        row["passed"], row["robustness"] = self.passed, self.robustness
        clean: dict[str, Any] = _finite(row)
        return clean


def _found(judgement: Judgement) -> str:
    if judgement.value is None:
        return f"margin {judgement.margin:.3g}"
    return "n/a" if math.isnan(judgement.value) else f"value {judgement.value:.3g}"


@dataclass(frozen=True, slots=True)
class Skipped:
    """A scenario that was not run, and why: shown and counted wherever results are."""

    name: str
    file: str
    why: str


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value


def judged(
    expectations: tuple[Expectation, ...], trace: Trace, figures: dict[str, float], *, safety: bool, where: str
) -> tuple[Judgement, ...]:
    """Verdicts in the order given. Raises InputError for a name that the run has no signal for."""
    return tuple(_judge_one(expectation, trace, figures, safety, where) for expectation in expectations)


def _speaks_at_rest(name: str) -> bool:
    """Whether a signal's initial value says something: no fault yet, nothing accepted yet."""
    return name.startswith("fault.") or name.endswith("_age_ms")


def _judge_one(
    expectation: Expectation, trace: Trace, figures: dict[str, float], safety: bool, where: str
) -> Judgement:
    if expectation.that is not None:
        try:
            verdict = judge(expectation.that, trace)
        except (UnknownSignal, FormulaError) as error:
            raise InputError(f"{where}: expectation `{expectation.that}`: {error}") from None
        unheard = sorted(name for name in signal_names(expectation.that) & trace.silent if not _speaks_at_rest(name))
        if unheard:
            raise InputError(
                f"{where}: expectation `{expectation.that}`: {', '.join(unheard)} never had a value in this run"
            )
        return Judgement(
            expectation.name or expectation.that,
            expectation.that,
            verdict.holds,
            verdict.robustness,
            verdict.at_ms,
            safety=safety,
            vacuous=verdict.idle_premises > 0,
        )
    assert expectation.figure is not None
    value = figures[expectation.figure]
    margins = []
    if expectation.at_least is not None:
        margins.append(value - expectation.at_least)
    if expectation.at_most is not None:
        margins.append(expectation.at_most - value)
    margin = min(margins)
    limits = " and ".join(
        f"{word} {limit:g}"
        for word, limit in (("at least", expectation.at_least), ("at most", expectation.at_most))
        if limit is not None
    )
    text = f"{expectation.figure} {limits}"
    return Judgement(expectation.name or text, text, bool(margin >= 0.0), margin, None, value, safety)
