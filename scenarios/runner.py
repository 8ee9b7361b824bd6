"""Many scenarios, in as many processes as asked for; what each leaves behind goes into one folder."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import joblib

from hilbridge.errors import InputError
from scenarios.judging import Result
from scenarios.junit import write_junit
from scenarios.run import run_scenario
from scenarios.schema import Scenario, reseeded


@dataclass(frozen=True, slots=True)
class RunOptions:
    """out: folder, or None to leave nothing behind."""

    out: Path | None = None
    seed: int | None = None
    jobs: int = 1
    profile: bool = False


def run_all(
    found: Sequence[tuple[Path, Scenario]], options: RunOptions, done: Callable[[str], None] = lambda name: None
) -> list[Result]:
    """Results in the order of the scenarios. Raises InputError for one that cannot be run."""
    calls = [joblib.delayed(_run_one)(path, scenario, options) for path, scenario in found]
    results: list[Result] = []
    for outcome in joblib.Parallel(n_jobs=options.jobs, return_as="generator")(calls):
        if isinstance(outcome, InputError):
            raise outcome
        results.append(outcome)
        done(outcome.name)
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        rows = [result.as_json() for result in results]
        (options.out / "results.json").write_text(json.dumps(rows, indent=1), encoding="utf-8")
        write_junit(results, options.out / "junit.xml")
    return results


def _run_one(path: Path, scenario: Scenario, options: RunOptions) -> Result | InputError:
    """In a worker: errors come back as values, since a pool may not carry them over."""
    scenario = reseeded(scenario, options.seed)
    name = file_name(scenario.name)
    folder = options.out
    try:
        recording = None if folder is None else folder / f"{name}.mcap"
        run = run_scenario(scenario, recording=recording, where=str(path), profile=options.profile)
    except InputError as error:
        return error
    replay = shlex.join(["hilscenario", "run", str(path), "--seed", str(scenario.seed)])
    page = ""
    if folder is not None:
        from scenarios.page import write_page

        page = str(write_page(run, folder / f"{name}.html"))
    result: Result = replace(run.result, replay=replay, page=page)
    return result


def file_name(name: str) -> str:
    """A scenario's name as a file's."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")
