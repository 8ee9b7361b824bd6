"""The same sessions with every device: each gate, an ACT at every tick, and the device left in FOLLOW."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

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
    visits: Sequence[Visit],
    compared: Sequence[Gate],
    jobs: int,
    progress: Callable[[str], None],
    log: Path | None = None,
) -> list[Outcome]:
    """Every session, in their order. What `log` holds of these gates already is not run again."""
    found = _known(log, compared)
    left = [visit for visit in visits if visit not in found]
    for visit in visits[len(left) :]:
        progress(visit.kind)
    calls = [joblib.delayed(session)(visit, compared) for visit in left]
    pool = joblib.Parallel(n_jobs=jobs, return_as="generator", initializer=end_with, initargs=(os.getpid(),))
    for visit, outcomes in zip(left, pool(calls), strict=True):
        found[visit] = outcomes
        progress(visit.kind)
        if log is not None:
            _keep(log, visit, compared, outcomes)
    return [outcome for visit in visits for outcome in found[visit]]


def _keep(log: Path, visit: Visit, compared: Sequence[Gate], outcomes: Sequence[Outcome]) -> None:
    """A line a session; it begins anew after a line that an interruption cut off."""
    row = {
        "visit": asdict(visit),
        "gates": [asdict(gate) for gate in compared],
        "sums": {one.device: one.sums for one in outcomes},
    }
    log.parent.mkdir(parents=True, exist_ok=True)
    torn = log.exists() and not log.read_bytes().endswith(b"\n")
    with log.open("a", encoding="utf-8") as file:
        file.write("\n" * torn + json.dumps(row) + "\n")


def _known(log: Path | None, compared: Sequence[Gate]) -> dict[Visit, list[Outcome]]:
    """What an earlier call left, less what it was interrupted in, and what was of other gates."""
    known: dict[Visit, list[Outcome]] = {}
    for line in [] if log is None or not log.exists() else log.read_text(encoding="utf-8").splitlines():
        with suppress(ValueError):
            row = json.loads(line)
            if row["gates"] == [asdict(gate) for gate in compared]:
                visit = Visit(**row["visit"])
                known[visit] = [Outcome(device, visit, sums) for device, sums in row["sums"].items()]
    return known
