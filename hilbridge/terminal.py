"""What a run looks like in a terminal: one live line while it runs, a short table when it is over."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from hilbridge.guard import Printer
from hilbridge.observe.summary import Summary
from hilbridge.records import Action
from hilbridge.rows import TickRow

if TYPE_CHECKING:  # they load drivers of buses and cameras, which a report does without
    from hilbridge.doctor import Finding
    from hilbridge.run import Outcome
    from hilbridge.runtime.account.stages import Stage

# Progress goes to stderr, so that `--json` on stdout stays one object.
_ERR = Printer(stderr=True)


class LiveLine:
    """A line that says what the bridge is doing, and lines above it that stay. Only those where nobody watches."""

    def __init__(self, bar: Progress | None, task: TaskID | None) -> None:
        self._bar, self._task = bar, task

    def tick(self, seconds: float, row: TickRow) -> None:
        """Show the newest tick."""
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, completed=seconds, description="running", now=describe(row))

    def notice(self, text: str) -> None:
        """Print a line that stays."""
        with suppress(OSError):  # the run matters more than what it says
            console = _ERR if self._bar is None else self._bar.console
            console.print(f"hilbridge: {escape(text)}", soft_wrap=True, highlight=False)

    def over(self, text: str) -> None:
        """Say that the run is over."""
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, description=text, now="")


@contextmanager
def live_line(seconds: float | None, quiet: bool) -> Iterator[LiveLine]:
    """The line while a run lasts."""
    if quiet or not _ERR.is_terminal:
        yield LiveLine(None, None)
        return
    columns = [TextColumn("{task.description}"), BarColumn(24), TimeElapsedColumn(), TextColumn("{task.fields[now]}")]
    with Progress(*columns, console=_ERR, transient=True) as bar:
        yield LiveLine(bar, bar.add_task("starting", total=seconds, now=""))


def describe(row: TickRow) -> str:
    """One tick in a few words."""
    device = row.device_state or "no device"
    if row.action is Action.ACT:
        return f"[bold green]ACT {row.verb}[/] {row.confidence:.2f}  device {device}"
    likely = f"{row.top_verb} {row.top_confidence:.2f}" if row.top_confidence is not None else ""
    return f"[yellow]HOLD[/] {row.reason}  {likely}  device {device}"


def print_summary(summary: Summary) -> None:
    """The figures of a recording, one a line, and what it lacks where it is not whole."""
    Printer().print(summary_table(summary))


def print_outcome(outcome: Outcome) -> None:
    """The summary of a run, and where its recording and report are."""
    print_summary(outcome.summary)
    console = Printer()
    if outcome.stages:
        console.print(stages_table(outcome.stages))
    console.print(f"recording  {outcome.recording}", soft_wrap=True, highlight=False)
    console.print(f"report     {outcome.report}", soft_wrap=True, highlight=False)


def stages_table(stages: Sequence[Stage]) -> Table:
    """How long each stage took."""
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    for heading in ("stage", "times", "p50 ms", "p99 ms", "max ms"):
        table.add_column(heading, justify="left" if heading == "stage" else "right")
    for one in stages:
        times_ms = (f"{value:.2f}" for value in (one.p50_ms, one.p99_ms, one.max_ms))
        table.add_row(escape(one.name), str(one.count), *times_ms)
    return table


def summary_table(summary: Summary) -> Table:
    def number(value: float | None, form: str = ".2f") -> str:
        return "n/a" if value is None else format(value, form)

    latency = summary.latency_ms
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    rows = {
        "seconds": number(summary.seconds, ".1f"),
        "acts / holds (episodes)": f"{summary.acts} / {summary.holds}",
        "act-only precision": number(summary.act_only_precision),
        "coverage (share of ticks)": number(summary.coverage),
        "false assists a minute": number(summary.false_assists_per_min, ".1f"),
        "device assisted for": f"{summary.assist_s:.1f} s",
        "hold reasons (ticks)": ", ".join(
            f"{reason} {count}" for reason, count in list(summary.hold_reasons.items())[:6]
        ),
        "latency p50 / p99 / max": f"{number(latency.p50, '.0f')} / {number(latency.p99, '.0f')} / "
        f"{number(latency.max, '.0f')} ms",
        "frames sent / received / lost": f"{summary.frames_sent} / {summary.frames_received} / {summary.frames_lost}",
        "ticks missed": str(summary.ticks_missed),
    }
    for name, value in rows.items():
        table.add_row(f"[dim]{name}[/]", value or "none")
    if summary.missing:
        table.add_row("[bold red]not whole[/]", escape(summary.missing))
    return table


@contextmanager
def status(text: str, quiet: bool) -> Iterator[Callable[[str], None]]:
    """A spinner that says what is being done. Nothing where nobody watches."""
    if quiet or not _ERR.is_terminal:
        yield lambda now: None
        return
    with _ERR.status(text) as spinner:
        yield lambda now: spinner.update(f"{text}: {now}")


@contextmanager
def counting(text: str, total: int) -> Iterator[Callable[[], None]]:
    """A progress bar that is told of each item done. Nothing where nobody watches."""
    if not _ERR.is_terminal:
        yield lambda: None
        return
    with Progress(console=_ERR, transient=True) as bar:
        task = bar.add_task(text, total=total)
        yield lambda: bar.advance(task)


@contextmanager
def steps(text: str, quiet: bool) -> Iterator[Callable[[int], Callable[[], None]]]:
    """A progress bar that is told of how many when that is known, then of each. Nothing where nobody watches."""
    if quiet or not _ERR.is_terminal:
        yield lambda total: lambda: None
        return
    with Progress(console=_ERR, transient=True) as bar:
        task = bar.add_task(text, total=None)

        def begin(total: int) -> Callable[[], None]:
            bar.update(task, total=total)
            return lambda: bar.advance(task)

        yield begin


@contextmanager
def counted(text: str, quiet: bool) -> Iterator[Callable[[], None]]:
    """How many items are done, where nobody knows of how many. Nothing where nobody watches."""
    if quiet or not _ERR.is_terminal:
        yield lambda: None
        return
    columns = [TextColumn("{task.description}"), BarColumn(24), TextColumn("{task.completed:,}"), TimeElapsedColumn()]
    with Progress(*columns, console=_ERR, transient=True) as bar:
        task, done = bar.add_task(text, total=None), 0

        def one() -> None:
            nonlocal done
            done += 1
            if done % 1000 == 0:  # a bar costs more than a frame
                bar.update(task, completed=done)

        yield one


def print_rows(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A plain table; long cells go on below."""
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim")
    for title in titles:
        table.add_column(title)
    for row in rows:
        table.add_row(*(escape(cell) for cell in row))
    printer = Printer()
    Printer(width=None if printer.is_terminal else 160).print(table)


def print_figures(figures: Mapping[str, float | None]) -> None:
    """Names and numbers, one a line."""
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    for name, value in figures.items():
        table.add_row(f"[dim]{name}[/]", "n/a" if value is None else f"{value:.4g}")
    Printer().print(table)


_MARKS = {"well": "[green]well[/]", "note": "[yellow]note[/]", "ill": "[bold red]ill[/]"}


def print_findings(findings: Sequence[Finding]) -> None:
    """What the doctor found; a cure stands under what it mends."""
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    for finding in findings:
        table.add_row(_MARKS[finding.verdict], f"[bold]{finding.subject}[/]", escape(finding.text))
        if finding.cure:
            table.add_row("", "", f"[dim]->[/] {escape(finding.cure)}")
    Printer().print(table)
