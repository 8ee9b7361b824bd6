"""`hilbridge evaluate --data ... --out DIR`: baseline and E1 to E5 in one HTML report, with CSV and JSON beside it."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from joblib import Parallel, delayed
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from hilbridge.intent.bundle import demo_bundle_path, load_bundle
from hilbridge.learning.calibrators import Method
from hilbridge.learning.certificate.study import study
from hilbridge.learning.experiments import tables
from hilbridge.learning.experiments.benchmark import Plan, network_path, people, run_network
from hilbridge.learning.experiments.beyond.paper_folds import FOLDS, record_one, recordings, run_fold
from hilbridge.learning.experiments.beyond.sections import estimator_sections, paper_section
from hilbridge.learning.experiments.closed_loop import (
    closed_loop_table,
    history_loop_table,
    runtime_table,
    tremor_table,
)
from hilbridge.learning.experiments.real_sections import real_sections
from hilbridge.learning.experiments.report import Section, as_row, curve_figure, reliability_figure, write_report
from hilbridge.learning.experiments.targets import target_section
from hilbridge.lease import end_with
from hilbridge.wearer.timeline import DEMO

Say = Callable[[str], None]
TREMOR_SEEDS = range(60, 66)
ABLATION_NOTE = (
    "Calibrators fitted anew for this set of valid modalities (own) against those fitted with all of them (global), the same "
    "calibration people. ratio: isotonic, own, over the global temperature; ratio temperature: the same of two temperatures. "
    "A ratio says little where the global temperature is near the noise floor already."
)


@dataclass(frozen=True, slots=True)
class Evaluation:
    """What `evaluate` made: the page, and every section's rows by key."""

    report: Path
    sections: tuple[Section, ...]
    minutes: float

    def rows(self, key: str) -> list[dict[str, object]]:
        """The rows of one section. Raises KeyError for a section that is not there."""
        for section in self.sections:
            if section.key == key:
                return [dict(row) for row in section.rows]
        raise KeyError(key)


def evaluate(
    data: str,
    out: Path,
    plan: Plan | None = None,
    workers: int = 2,
    comparators: bool = True,
    say: Say = lambda _: None,
) -> Evaluation:
    """Run everything for `data`: "synthetic", or the folder of the EGTEA Gaze+ package for the real sections.

    Goes on where an interrupted run with the same `out` and plan left off. Raises DatasetError for a folder that is none.
    """
    start = time.perf_counter()
    plan = plan or Plan()
    sections = list(
        synthetic_sections(out / "work", plan, workers, comparators, say)
        if data == "synthetic"
        else real_sections(Path(data), say)
    )
    minutes = (time.perf_counter() - start) / 60.0
    facts = {"data": data, "minutes of this run": round(minutes, 1)}
    if data == "synthetic":
        facts["people to train, stop, calibrate, test"] = ", ".join(
            str(count) for count in (plan.training, plan.validation, plan.calibration, plan.test)
        )
    report = write_report(out, f"hilbridge evaluation: {data}", sections, facts)
    return Evaluation(report, tuple(sections), minutes)


def synthetic_sections(work: Path, plan: Plan, workers: int, comparators: bool, say: Say) -> Sequence[Section]:
    """E1 to E5 on simulated wearers, networks in parallel."""
    work.mkdir(parents=True, exist_ok=True)
    seeds = [(part, seed) for part, own in plan.seeds().items() for seed in own]
    # The longest first, so that no worker waits for the other at the end.
    kinds = ["gru", *(["transformer"] if comparators else []), "taught", "overfit"]
    kinds += ["member-1", "member-2"] if comparators else []
    say(f"recording {len(seeds)} simulated wearers, {plan.seconds:g} s each")
    _all(workers, "recording people", _record, [(plan, part, seed, work) for part, seed in seeds])
    say(f"training {len(kinds)} networks: {', '.join(kinds)} (their logs: {work}/network-*/train.csv)")
    _all(workers, "training networks", run_network, [(plan, work, kind) for kind in kinds])

    say("training the paper's recipe, three folds of people")
    _all(workers, "recording their people", record_one, [(work, plan.paper, *one) for one in recordings(plan.paper)])
    wanted = [(recipe, fold) for recipe in plan.paper.recipes for fold in range(FOLDS)]
    _all(workers, "training folds", run_fold, [(work, plan.paper, fold, recipe) for recipe, fold in wanted])

    def kept(*wanted: str) -> list[tables.Fold]:
        return tables.load_folds([network_path(plan, work, kind) for kind in wanted])

    say("judging")
    pooled, taught, overfit = (tables.Pooled(kept(kind)) for kind in ("gru", "taught", "overfit"))
    members = {"transformer": kept("transformer"), "ensemble": kept("member-1", "member-2")} if comparators else {}
    sections = [
        *_calibration_sections(pooled, taught, overfit),
        *_selective_sections(pooled, taught),
        *_loop_sections(pooled, say),
        *_other_sections(pooled, members, plan),
        *estimator_sections(pooled, members.get("ensemble", ())),
        paper_section([(repr(recipe), run_fold(work, plan.paper, fold, recipe)) for recipe, fold in wanted]),
    ]
    return [target_section(sections), *sections]


def _all(workers: int, what: str, function: Callable[..., Any], jobs: Sequence[tuple[Any, ...]]) -> list[Any]:
    """Run `function` on each job's arguments with a progress bar on stderr; the results in any order.

    Ctrl-C reaches every process of a terminal: only this one answers, and takes its workers with it.
    """
    made = []
    run = delayed(_undisturbed)
    columns = [TextColumn("{task.description}"), BarColumn(24), MofNCompleteColumn(), TimeElapsedColumn()]
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(what, total=len(jobs))
        pool = Parallel(n_jobs=workers, return_as="generator_unordered", initializer=end_with, initargs=(os.getpid(),))
        calls = [run(os.getpid(), function, arguments) for arguments in jobs]
        for result in pool(calls):
            made.append(result)
            bar.advance(task)
    return made


def _undisturbed(parent: int, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """Call `function` in a worker that leaves Ctrl-C to its parent; with one worker that is the parent itself."""
    if os.getpid() != parent:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    return function(*arguments)


def _record(plan: Plan, part: str, seed: int, work: Path) -> None:
    people(plan, part, work, [seed])


def _calibration_sections(pooled: tables.Pooled, taught: tables.Pooled, overfit: tables.Pooled) -> list[Section]:
    right = pooled.right()
    diagram = reliability_figure({str(method): (pooled.confidence(method), right) for method in Method})
    wrong = overfit.right()
    hot = reliability_figure({str(method): (overfit.confidence(method), wrong) for method in Method})
    return [
        Section(
            "baseline",
            "Baseline accuracy",
            "synthetic",
            tables.baseline(pooled, taught),
            "2 s windows ending 0.52 s before onset; intervals by subject. Bayes knows what the simulated person shows and "
            "how clearly; from this preparation alone nothing does better. What of it can be reached from these windows and "
            "sensors of people never met lies between Bayes and the same network taught by Bayes: trained on the same "
            "people, half as long, on the best possible belief before each action instead of the one verb that followed.",
        ),
        Section(
            "e1_calibration",
            "E1: calibration",
            "synthetic",
            tables.calibration_table(pooled),
            "Calibrators fitted on people of their own, judged on the test people.",
            diagram,
        ),
        Section(
            "e1_overfit",
            "E1: calibration of an overfitted network",
            "synthetic",
            tables.calibration_table(overfit),
            "No regularisation and no early stopping: the overconfidence the paper reports.",
            hot,
        ),
        Section(
            "e2_ablation",
            "E2: one modality lost",
            "synthetic",
            tables.ablation_table(pooled),
            ABLATION_NOTE,
        ),
        Section(
            "e2_overfit",
            "E2: one modality lost, the overfitted network (no modality dropout)",
            "synthetic",
            tables.ablation_table(overfit),
            ABLATION_NOTE,
        ),
        Section(
            "e2_curvature",
            "E2: Laplace curvature by layer",
            "synthetic",
            tables.curvature_table(pooled),
            "Diagonal Fisher information per parameter.",
        ),
    ]


def _selective_sections(pooled: tables.Pooled, taught: tables.Pooled) -> list[Section]:
    selective = tables.selective_table(pooled, taught)
    lines = {
        "GRU, isotonic": ([row["coverage"] for row in selective], [row["act_only_precision"] for row in selective]),
        "Bayes": ([row["coverage"] for row in selective], [row["bayes"] for row in selective]),
    }
    paper = {"paper, balanced": (0.5, 0.65), "paper, conservative": (0.25, 0.8)}
    curve = curve_figure(lines, "coverage", "act-only precision", paper)
    return [
        Section(
            "e3_selective",
            "E3: act-only precision against coverage",
            "synthetic",
            selective,
            "Intervals by subject.",
            curve,
        ),
        Section(
            "e3_thresholds",
            "E3: what a threshold means",
            "synthetic",
            tables.threshold_table(pooled),
            "epsilon: largest gap of a bin in the region, as observed (the paper's bound AOP >= tau - epsilon).",
        ),
        Section("e3_verbs", "E3: act-only precision by verb", "synthetic", tables.verb_table(pooled)),
    ]


def _loop_sections(pooled: tables.Pooled, say: Say) -> list[Section]:
    """What running it live costs, and how the gate acts on people it has not seen."""
    say("closed loop")
    loop = closed_loop_table(pooled)
    lines = {
        method: (
            [row["tau_on"] for row in loop if row["method"] == method],
            [row["act_only_precision"] for row in loop if row["method"] == method],
        )
        for method in ("none", "gate")
    }
    return [
        Section(
            "e4_runtime",
            "E4: runtime, and what the alternatives would cost",
            "synthetic",
            runtime_table(),
            "Measured in this run on one thread, untrained weights of the full size (64, 256): cost does not depend on them.",
        ),
        Section(
            "e5_closed_loop",
            "E5: closed loop through core.gate",
            "synthetic",
            loop,
            "Held-out logits of unseen people, every 40 ms; right is the verb in preparation or under way; none takes the "
            "smoothed probability at its word, gate calibrates it on every tick of other people; tau_off = tau_on - 0.05. "
            "Lead time is the time left until the next onset. The paper's closed loop acts within windows before onsets "
            "only; here the whole stream counts.",
            curve_figure(
                lines, "tau_on", "act-only precision", {"paper, calibrated": (0.5, 0.8), "paper, not": (0.5, 0.62)}
            ),
        ),
        Section(
            "e5_history",
            "Beyond: E5 with believed history fused in",
            "synthetic",
            history_loop_table(pooled),
            "What was done before is only what the system itself believed; no detector of action boundaries. Its setting is "
            "chosen on validation people. The wearer lives by the filter's own transitions: an upper bound for real people.",
        ),
    ]


def _other_sections(pooled: tables.Pooled, members: dict[str, list[tables.Fold]], plan: Plan) -> list[Section]:
    """The tremor guard, other sources of uncertainty, and whether certificates keep their promise."""
    bundle = load_bundle(demo_bundle_path())
    return [
        Section(
            "tremor",
            "Trembling people, demo bundle",
            "synthetic",
            tremor_table(bundle, DEMO, TREMOR_SEEDS, 40.0),
            "Tremor of 0.02 picture widths that wanders, with head, gaze, lost hands and overshoot. off: judged by the map of "
            "calm people; on: by that of the level of tremor, and held where no confidence could reach tau_on.",
        ),
        Section(
            "comparators",
            "Laplace, MC dropout, transformer, ensemble",
            "synthetic",
            tables.comparator_table(pooled, members),
            "What each costs a prediction is in E4. Transformer and the ensemble's two other members were trained for a third "
            "of the epochs.",
        ),
        Section(
            "certificates",
            "Do certified thresholds keep their promise?",
            "synthetic",
            [as_row(row) for row in study(200, plan.certificates, 0.8, 0.1)],
            "Simulated calibration sets of 200 people, windows repeated 25 times, subject shift; precision 0.8 at "
            "delta 0.1. Clopper-Pearson is there to be seen failing.",
        ),
    ]
