"""Campaigns: every fault at many instants in every gate state, ranked by how near each run came to hurting somebody.

`hilbridge.cluster` runs the samples on all cores, or on a Ray or Dask cluster; this file only says what to run and keeps
what came back, so that an interrupted campaign goes on where it was.
"""

from __future__ import annotations

import json
import random
import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from hilbridge.cluster import run_all, workers
from hilbridge.errors import InputError
from hilbridge.files import write_whole
from hilbridge.guard import sure_to_end
from hilscenario.format.files import dump_scenario, scenario_of
from hilscenario.format.schema import Expectation, Scenario, Step
from hilscenario.format.vocabulary import FAULTS
from hilscenario.lockstep.run import run_scenario
from hilscenario.signals.stl import first_ms

# Where a fault is injected: the gate's state at that moment, as conditions on signals.
GATE_STATES: dict[str, str] = {
    "hold": "device.state == Ready",
    "turning to act": "gate.act",
    "acting": "device.assist_nm != 0",
    "turning to hold": "device.state == RampDown",
}
_AFTER_MS = {"hold": 250.0, "turning to act": 60.0, "acting": 900.0, "turning to hold": 45.0}
# What a short run needs in place of a fault's defaults.
_OPTIONS: dict[str, dict[str, float]] = {"bus.replay": {"past_s": 0.3}, "bridge.restart": {"down_ms": 200.0}}
# A sample is watched for so long after its fault: three times the longest deadline of the contract.
_WATCHED_MS = 500.0
_INSTANT_MS = 300.0  # what follows from a fault without a length: a restart, three STOPs
_CHUNK = 1024  # a cluster gives back so many at once; between two of them cores stand idle


@dataclass(frozen=True, slots=True)
class Sample:
    """One injection: a fault, `after_ms` after the gate came to `gate`, in a run that ends at `end_ms`."""

    fault: str
    gate: str
    after_ms: float
    for_ms: float
    end_ms: int
    number: int

    @property
    def key(self) -> str:
        """Identifies the sample in a resumed campaign."""
        return f"{self.fault}|{self.gate}|{self.after_ms}|{self.for_ms}|{self.end_ms}|{self.number}"

    @property
    def file_name(self) -> str:
        """The file that repeats it."""
        return f"{self.fault}-{self.number}.yaml"


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of one sample. `robustness` is the smallest margin of the safety expectations."""

    sample: Sample
    safe: bool
    took_effect: bool
    robustness: float
    zero_ms: float
    problems: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """The outcome as a line of campaign.jsonl."""
        return asdict(self)


def samples_of(base: Scenario, instants: int, seed: int, only: tuple[str, ...] = ()) -> list[Sample]:
    """`instants` random moments for every fault in every gate state.

    Raises InputError for an unknown fault, or where the base never comes to one of the gate states.
    """
    unknown = [fault for fault in only if fault not in FAULTS]
    if unknown:
        raise InputError(f"unknown fault `{unknown[0]}`; `hilscenario faults` lists them")
    reached_ms = _reached_ms(base)
    made: list[Sample] = []
    for fault in only or sorted(FAULTS):
        for gate in GATE_STATES:
            chance = random.Random(f"{seed}.{fault}.{gate}")
            for instant in range(instants):
                after_ms = round(chance.uniform(0.0, _AFTER_MS[gate]), 3)
                for_ms = 0.0 if FAULTS[fault].instant else round(chance.choice((60.0, 150.0, 300.0, 600.0)), 1)
                end_ms = reached_ms[gate] + after_ms + (for_ms or _INSTANT_MS) + _WATCHED_MS
                made.append(Sample(fault, gate, after_ms, for_ms, round(end_ms), instant))
    return made


def _reached_ms(base: Scenario) -> dict[str, float]:
    """When the base scenario without faults first reaches each gate state."""
    trace = run_scenario(base).trace
    reached: dict[str, float] = {}
    for gate, condition in GATE_STATES.items():
        at_ms = first_ms(condition, trace)
        if at_ms is None:
            raise InputError(f"{base.name}: never comes to `{gate}` ({condition}), so no fault can be injected there")
        reached[gate] = at_ms
    return reached


def scenario_for(base: Scenario, sample: Sample) -> Scenario:
    """The base scenario with that one injection; only the safety expectations are judged."""
    step: dict[str, Any] = {
        "when": GATE_STATES[sample.gate],
        "after": f"{sample.after_ms} ms",
        "fault": sample.fault,
        "with": _OPTIONS.get(sample.fault, {}),
    }
    if sample.for_ms:
        step["for"] = f"{sample.for_ms} ms"
    return base.model_copy(
        update={
            "name": f"{base.name}: {sample.fault} at {sample.gate} + {sample.after_ms} ms",
            "seed": base.seed + zlib.crc32(sample.key.encode()) % 1_000_000,
            "wearer": base.wearer.model_copy(update={"seed": base.wearer.seed or base.seed}),
            "duration": min(base.duration, sample.end_ms * 1_000_000),
            "steps": (*base.steps, Step.model_validate(step)),
            "expect": (Expectation(that="always device.assist_nm <= 2.001"),),
        }
    )


def run_sample(base: Scenario, sample: Sample) -> Outcome:
    """Runs one sample in a worker."""
    result = run_scenario(scenario_for(base, sample)).result
    problems = tuple(f"{j.name} (margin {j.margin:.3g})" for j in result.judgements if not j.holds)
    return Outcome(
        sample,
        not problems,
        result.faults[-1].worked,
        result.robustness,
        result.figures["zero_after_fault_ms"],
        problems,
    )


def run_campaign(
    base: Scenario,
    samples: Sequence[Sample],
    out: Path,
    *,
    jobs: int = -1,
    cluster: str | None = None,
    progress: Callable[[str], None] = lambda name: None,
) -> list[Outcome]:
    """Run what `out` does not hold yet; all outcomes, the nearest to harm first. Raises InputError.

    What a worker that died had not given back is run again.
    """
    out.mkdir(parents=True, exist_ok=True)
    log = out / "campaign.jsonl"
    known = _known(log, base)
    outcomes = [known[sample.key] for sample in samples if sample.key in known]
    for _ in outcomes:
        progress("")
    left = [sample for sample in samples if sample.key not in known]
    torn = log.exists() and not log.read_bytes().endswith(b"\n")
    with log.open("a", encoding="utf-8") as file, workers(jobs, cluster) as pools, sure_to_end("hilscenario"):
        if torn:  # a last line cut off by an interruption must not swallow the next one
            file.write("\n")
        if not known and file.tell() == 0:
            file.write(json.dumps({"base": _fingerprint(base)}) + "\n")

        def keep(outcome: Outcome) -> None:
            outcomes.append(outcome)
            file.write(json.dumps(outcome.as_json()) + "\n")
            file.flush()
            progress(outcome.sample.fault)
            if not outcome.safe:
                write_whole(out / outcome.sample.file_name, dump_scenario(scenario_for(base, outcome.sample)))

        for start in range(0, len(left), _CHUNK):
            run_all(pools, run_sample, [(base, sample) for sample in left[start : start + _CHUNK]], "campaign", keep)
    return sorted(outcomes, key=lambda outcome: (outcome.safe, outcome.robustness))


def _fingerprint(base: Scenario) -> str:
    return f"{zlib.crc32(dump_scenario(base).encode()):08x}"


def _known(log: Path, base: Scenario) -> dict[str, Outcome]:
    """What an earlier, interrupted call left. Raises InputError for the log of another scenario; drops a torn line."""
    if not log.exists():
        return {}
    known: dict[str, Outcome] = {}
    for number, line in enumerate(log.read_text(encoding="utf-8").splitlines()):
        try:
            row = json.loads(line)
        except ValueError:
            continue
        if number == 0:
            if row.get("base") != _fingerprint(base):
                raise InputError(f"{log}: belongs to another scenario; name another folder with --out")
            continue
        sample = Sample(**row.pop("sample"))
        known[sample.key] = Outcome(sample, **{**row, "problems": tuple(row["problems"])})
    return known


def base_scenario() -> Scenario:
    """What the project's own campaign starts from: a scripted belief that makes every gate state in three seconds."""
    return scenario_of(
        {
            "name": "campaign",
            "seed": 11,
            "duration": "3 s",
            "intent": [
                {"at": "0.6 s", "verb": "Pour", "confidence": 0.97},
                {"at": "1.7 s", "verb": "Pour", "confidence": 0.1},
                {"at": "2.2 s", "verb": "Mix", "confidence": 0.97},
            ],
            "gate": {"alpha": 0.6, "refractory": "80 ms"},
            "expect": [{"that": "always device.assist_nm <= 2.001"}],
        }
    )
