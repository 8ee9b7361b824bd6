"""Terminal output: a progress bar, then a table, then the command that repeats a failure."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from hilscenario.format.schema import FIGURES
from hilscenario.lockstep.controller import controller_in_use
from hilscenario.verdict.judging import Result, Skipped

if TYPE_CHECKING:
    from hilscenario.campaign import Outcome


COLUMNS = {
    "precision": "act_only_precision",
    "worst zero": "zero_after_fault_ms",
    "margin": "smallest robustness of all safety expectations: how near the run came to breaking the contract",
    "faults": "how often the injected faults took effect",
    "CPU, took": "processor time of a run in virtual time; time by the clock of a live one",
}


@contextmanager
def progress_bar(total: int, *, quiet: bool) -> Iterator[Callable[[str], None]]:
    """A progress bar on standard error; gives the callback to call after each item, with its name."""
    console = Console(stderr=True)
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=console, transient=True, disable=quiet or not console.is_terminal) as bar:
        task = bar.add_task("", total=total)
        yield lambda name: bar.update(task, advance=1, description=name)


def print_rows(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A plain table, the first column to the left."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for title in titles:
        table.add_column(title, justify="left" if title == titles[0] else "right")
    for row in rows:
        table.add_row(*row)
    Console(width=None if Console().is_terminal else 120).print(table)


def print_results(results: Sequence[Result], out: Path | None, skipped: Sequence[Skipped] = ()) -> None:
    """The table, then what failed and how to repeat it, and what was not run and why."""
    console = Console(width=None if Console().is_terminal else 120)
    table = Table(box=None, pad_edge=False, header_style="bold")
    live = any(result.live for result in results)
    for title in ("", "scenario", "coverage", "precision", "worst zero", "margin", "faults", "took" if live else "CPU"):
        table.add_column(title, justify="left" if title in ("", "scenario") else "right")
    for result in results:
        figures = result.figures
        precision = figures["act_only_precision"]
        table.add_row(
            "[green]ok[/]" if result.passed else "[red]FAILED[/]",
            result.name,
            f"{figures['coverage']:.2f}",
            "n/a" if math.isnan(precision) else f"{precision:.2f}",
            f"{figures['zero_after_fault_ms']:.0f} ms",
            "-" if math.isinf(result.robustness) else f"{result.robustness:.2g}",
            str(sum(fault.effects for fault in result.faults)),
            f"{result.cpu_s:.1f} s",
        )
    console.print(table)
    failed = [result for result in results if not result.passed]
    for result in failed:
        console.print(f"\n[red]{result.name}[/]")
        for line in result.problems():
            console.print(f"  {line}", highlight=False)
        console.print(f"  repeat: {result.replay}", highlight=False, soft_wrap=True)
    _print_vacuous(console, results)
    for result in results:
        if result.profile:
            _print_profile(console, result)
    seconds, cpu_s = sum(r.seconds for r in results), sum(r.cpu_s for r in results)
    for one in skipped:
        console.print(f"[yellow]skipped[/] {one.name}: {one.file}: {one.why}", highlight=False, soft_wrap=True)
    took = f"{cpu_s:.0f} s"
    if not live:
        took = (
            f"{cpu_s:.1f} s of processor time ({seconds / max(cpu_s, 1e-9):.0f} x, controller in {controller_in_use()})"
        )
    console.print(
        f"\n{len(results) - len(failed)} of {len(results)} passed"
        + (f", {len(skipped)} skipped" if skipped else "")
        + f"; {seconds:.0f} s of the system's life in {took}"
        + (f"; {out}" if out else "")
        + "; `hilscenario figures` says what the columns mean"
    )


def _print_vacuous(console: Console, results: Sequence[Result]) -> None:
    """Expectations that passed and were never put to the test: the premise of an implication in them held at no time."""
    safety: Counter[str] = Counter()
    for result in results:
        for judgement in result.judgements:
            if judgement.is_vacuous_pass and judgement.safety:
                safety[judgement.name] += 1
            elif judgement.is_vacuous_pass:
                console.print(f"[yellow]vacuous[/] {result.name}: {judgement.name}", highlight=False, soft_wrap=True)
    for name, count in safety.items():
        where = f"in {count} of {len(results)} scenarios"
        console.print(f"[yellow]vacuous[/] contract: {name}: {where}", highlight=False, soft_wrap=True)


def print_figures() -> None:
    """What every column and every figure means."""
    table = Table(box=None, pad_edge=False, show_header=False)
    for name, meaning in {**FIGURES, **COLUMNS}.items():
        table.add_row(f"[bold]{name}[/]", escape(meaning))
    Console().print(table)


def _print_profile(console: Console, result: Result) -> None:
    console.print(f"\n{result.name}: milliseconds of processor time per second of the system's life")
    for part, ms in sorted(result.profile.items(), key=lambda item: -item[1]):
        console.print(f"  {part:<28} {ms:7.2f}", highlight=False)


def print_campaign(outcomes: Sequence[Outcome], base: Path, out: Path) -> None:
    """The samples that came nearest to hurting somebody, nearest first."""
    console = Console(width=None if Console().is_terminal else 120)
    table = Table(box=None, pad_edge=False, header_style="bold")
    for title in ("fault", "samples", "unsafe", "no effect", "smallest margin", "worst zero"):
        table.add_column(title, justify="left" if title == "fault" else "right")
    for name in sorted({outcome.sample.fault for outcome in outcomes}):
        mine = [outcome for outcome in outcomes if outcome.sample.fault == name]
        unsafe = sum(not outcome.safe for outcome in mine)
        table.add_row(
            name,
            str(len(mine)),
            f"[red]{unsafe}[/]" if unsafe else "0",
            str(sum(not outcome.took_effect for outcome in mine)),
            f"{min(outcome.robustness for outcome in mine):.3g}",
            f"{max(outcome.zero_ms for outcome in mine):.0f} ms",
        )
    console.print(table)
    bad = [outcome for outcome in outcomes if not outcome.safe]
    for outcome in bad[:10]:
        console.print(f"[red]unsafe[/] {outcome.sample} {outcome.problems}", highlight=False, soft_wrap=True)
        console.print(f"  repeat: hilscenario run {out}/{outcome.sample.file_name}", highlight=False, soft_wrap=True)
    console.print(f"\n{len(outcomes)} samples of {base}, {len(bad)} unsafe; {out}/campaign.jsonl")
