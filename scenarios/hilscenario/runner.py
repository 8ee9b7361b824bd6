"""Many scenarios, in as many processes as asked for; what each leaves behind goes into one folder."""

from __future__ import annotations

import json
import os
import re
import shlex
import unicodedata
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import joblib

from hilbridge.bus.port.spec import BusSpec
from hilbridge.errors import InputError
from hilbridge.files import write_whole
from hilbridge.lease import end_with
from hilscenario.format.files import line_of, reseeded
from hilscenario.format.schema import Scenario
from hilscenario.live.external import External
from hilscenario.live.possible import impossible_live
from hilscenario.live.run import run_live
from hilscenario.lockstep.run import run_scenario
from hilscenario.verdict.judging import Result, Skipped
from hilscenario.verdict.junit import write_junit

_NAME_LIMIT_BYTES = 100  # of a file's, without its ending


@dataclass(frozen=True, slots=True)
class RunOptions:
    """out: folder, or None to leave nothing behind."""

    out: Path | None = None
    seed: int | None = None
    jobs: int = 1
    profile: bool = False
    live: BusSpec | None = None  # the bus to run on with real processes, one scenario after the other
    external: External | None = None  # the device is the user's own


def sort_out(
    found: Sequence[tuple[Path, Scenario]], named: Collection[Path], live: BusSpec | None, *, external: bool = False
) -> tuple[list[tuple[Path, Scenario]], list[Skipped]]:
    """What can run, and what of a folder cannot live. Raises InputError for such a one among the files `named`."""
    able: list[tuple[Path, Scenario]] = []
    skipped: list[Skipped] = []
    for path, scenario in found:
        cannot = None if live is None else impossible_live(scenario, live, external=external)
        if cannot is None:
            able.append((path, scenario))
            continue
        line = f"{path}:{line_of(path, cannot.location)}"
        if path in named:
            raise InputError(f"{line}: {cannot.why}")
        skipped.append(Skipped(scenario.name, line, cannot.why))
    return able, skipped


def refuse_recorded(out: Path, scenarios: Sequence[Scenario]) -> None:
    """A live run cannot be had again: its recording is not replaced unasked. Raises InputError.

    One in virtual time is replaced, since its scenario and seed give the same bytes.
    """
    for name in file_names(scenarios):
        recording = out / f"{name}.mcap"
        if recording.exists():
            raise InputError(f"{recording}: is there already; name another folder, or replace it with --force")


def run_all(
    found: Sequence[tuple[Path, Scenario]],
    options: RunOptions,
    progress: Callable[[str], None] = lambda name: None,
    skipped: Sequence[Skipped] = (),
) -> list[Result]:
    """Results in the order of the scenarios. Raises InputError for one that cannot be run."""
    results: list[Result] = []
    for outcome in _outcomes(found, options):
        if isinstance(outcome, InputError):
            raise outcome
        results.append(outcome)
        progress(outcome.name)
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        rows = [result.as_json() for result in results] + [{**asdict(one), "passed": None} for one in skipped]
        write_whole(options.out / "results.json", json.dumps(rows, indent=1))
        write_junit(results, options.out / "junit.xml", skipped)
    return results


def _outcomes(found: Sequence[tuple[Path, Scenario]], options: RunOptions) -> Iterator[Result | InputError]:
    named = list(zip(found, file_names([scenario for _, scenario in found]), strict=True))
    if options.live is not None:  # real time: one after the other, and none in a pool's worker
        return (_run_one(path, scenario, name, options) for (path, scenario), name in named)
    calls = [joblib.delayed(_run_one)(path, scenario, name, options) for (path, scenario), name in named]
    outcomes: Iterator[Result | InputError] = joblib.Parallel(
        n_jobs=options.jobs, return_as="generator", initializer=end_with, initargs=(os.getpid(),)
    )(calls)
    return outcomes


def _run_one(path: Path, scenario: Scenario, name: str, options: RunOptions) -> Result | InputError:
    """In a worker: errors come back as values, since a pool may not carry them over."""
    scenario = reseeded(scenario, options.seed)
    folder = options.out
    try:
        recording = None if folder is None else folder / f"{name}.mcap"
        if options.live is None:
            run = run_scenario(scenario, recording=recording, where=str(path), profile=options.profile)
        else:
            run = run_live(scenario, options.live, recording=recording, where=str(path), external=options.external)
    except InputError as error:
        return error
    live = [] if options.live is None else ["--live", "--bus", str(options.live)]
    if options.external is not None:
        plant = [] if options.external.plant_bus is None else ["--plant-bus", options.external.plant_bus]
        live += ["--device", "external", *plant]
        live += ["--i-am-on-a-bench"] if options.external.on_a_bench else []
        live += [] if options.external.key_file is None else ["--key-file", str(options.external.key_file)]
    replay = shlex.join(["hilscenario", "run", str(path), "--seed", str(scenario.seed), *live])
    page = ""
    if folder is not None:
        from hilscenario.verdict.page import write_page

        page = str(write_page(run, folder / f"{name}.html"))
    result: Result = replace(run.result, replay=replay, page=page)
    return result


def file_name(name: str) -> str:
    """A scenario's name as a file's: letters and digits of any script."""
    plain = re.sub(r"[\W_]+", "-", unicodedata.normalize("NFC", name).lower()).strip("-")
    return plain.encode()[:_NAME_LIMIT_BYTES].decode(errors="ignore").strip("-") or "scenario"


def file_names(scenarios: Sequence[Scenario]) -> list[str]:
    """A file name for each of the scenarios; where two would have the same, the later is numbered."""
    given: dict[str, None] = {}
    for scenario in scenarios:
        first = name = file_name(scenario.name)
        number = 1
        while name in given:
            number += 1
            name = f"{first}-{number}"
        given[name] = None
    return list(given)
