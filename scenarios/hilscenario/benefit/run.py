"""The same sessions with every device: each gate, an ACT at every tick, and the device left in FOLLOW."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import joblib

from hilbridge.lease import end_with
from hilscenario.benefit.gates import Gate, Order, always, decided, orders, without_wrong
from hilscenario.benefit.measured import Sums, Wanted, measure, wanted
from hilscenario.benefit.played import Played, play
from hilscenario.benefit.visits import Visit, wearer_of

OFF, CALIBRATED, UNCALIBRATED, ALWAYS = "off", "calibrated", "uncalibrated", "always on"
SHARP = "overconfident"
SHARPENED = 1.0 / 3.0  # temperature: a network three times as sure of everything


@dataclass(frozen=True)
class Outcome:
    """One session with one device."""

    device: str
    visit: Visit
    sums: Sums


def gates(raw_taus: Sequence[float] = ()) -> list[Gate]:
    """What is compared; `raw_taus`: the uncalibrated gate at other thresholds too, to find where it helps as much."""
    others = [Gate(f"{UNCALIBRATED} {tau:g}", 1.0, tau) for tau in raw_taus]
    return [Gate(CALIBRATED), Gate(UNCALIBRATED, 1.0), *others, Gate(SHARP, SHARPENED)]


def session(visit: Visit, compared: Sequence[Gate]) -> list[Outcome]:
    """One session with every device. The device that is off has the same tremor and plan, and no orders."""
    plan, off = wanted(visit), play(visit, ())
    asked = {OFF: list[Order]()}
    for gate in compared:
        rows, wearer = decided(visit, gate), wearer_of(visit)
        asked[gate.name] = orders(rows, wearer)
        asked.setdefault(ALWAYS, always(rows, wearer))
    return [Outcome(name, visit, _sums(visit, own, plan, off)) for name, own in asked.items()]


def _sums(visit: Visit, asked: list[Order], plan: Wanted, off: Played) -> Sums:
    """Runs that are known already, and twins that have nothing to leave out, are not run again."""
    played = play(visit, asked) if any(one.verb is not None for one in asked) else off
    twin = without_wrong(asked)
    beside = played if twin == asked else play(visit, twin)
    return measure(played, beside, asked, plan)


def compare(
    visits: Sequence[Visit], compared: Sequence[Gate], jobs: int, progress: Callable[[str], None]
) -> list[Outcome]:
    """Every session, in their order."""
    calls = [joblib.delayed(session)(visit, compared) for visit in visits]
    found: list[Outcome] = []
    pool = joblib.Parallel(n_jobs=jobs, return_as="generator", initializer=end_with, initargs=(os.getpid(),))
    for visit, outcomes in zip(visits, pool(calls), strict=True):
        found += outcomes
        progress(f"person {visit.person}, session {visit.session}")
    return found
