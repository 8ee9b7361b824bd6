"""The page of a replay: both traces on one time axis, and what differs. It needs no network and no script to be read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
import markupsafe

from hilbridge.errors import InputError
from hilbridge.observe.report import as_svg
from hilbridge.records import Action
from hilbridge.replay.difference import Compared, Difference

_RECORDED, _NOW = "#1d3557", "#e07a1f"


def write_page(target: Path, difference: Difference, traces: Traces) -> None:
    """Write it. Raises InputError where it cannot be written."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("hilbridge.replay"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    page = environment.get_template("replay.html").render(
        difference=difference, text=difference.as_text(), traces=markupsafe.Markup(traces.as_svg(difference))
    )
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(page, encoding="utf-8")
    except OSError as error:
        raise InputError(f"page {target}: {error.strerror}; name a file that can be written with --out") from None


class Traces:
    """What a page draws of each tick: a handful of numbers, so that a long recording fits."""

    def __init__(self) -> None:
        self._times_s: list[float] = []
        self._confidences: tuple[list[float], list[float]] = ([], [])
        self._acts: tuple[list[bool], list[bool]] = ([], [])
        self._differs: list[bool] = []
        self._from_ns: int | None = None

    def watch(self, compared: Compared) -> None:
        """The next tick."""
        row, now = compared.row, compared.decision
        if self._from_ns is None:
            self._from_ns = row.time_ns
        self._times_s.append((row.time_ns - self._from_ns) / 1e9)
        for kept, value in zip(self._confidences, (row.confidence, now.confidence), strict=True):
            kept.append(value)
        for acts, action in zip(self._acts, (row.action, now.action), strict=True):
            acts.append(action is Action.ACT)
        self._differs.append(compared.differs)

    def as_svg(self, difference: Difference) -> str:
        """Confidence of both against the thresholds; below it who acts when, and where they differ."""
        import matplotlib

        matplotlib.use("Agg")
        import matplotlib.pyplot as plt

        figure, (top, bars) = plt.subplots(
            2, 1, figsize=(11, 5), sharex=True, height_ratios=[3, 1], layout="constrained"
        )
        top.plot(self._times_s, self._confidences[0], color=_RECORDED, lw=1.4, label="recorded")
        top.plot(self._times_s, self._confidences[1], color=_NOW, lw=1.0, ls="--", label="now")
        for name, tau, style in (("tau_on", difference.tau_on, "-"), ("tau_off", difference.tau_off, ":")):
            top.axhline(tau, color="#d1495b", ls=style, lw=1, label=f"{name} = {tau:.2f} now")
        top.set(ylim=(0, 1.02), ylabel="confidence")
        top.legend(loc="upper right", fontsize=8, ncols=4)
        for place, acts, colour in ((2, self._acts[0], _RECORDED), (1, self._acts[1], _NOW)):
            self._bar(bars, place, acts, colour)
        self._bar(bars, 0, self._differs, "#d1495b")
        bars.set(
            yticks=[0.5, 1.5, 2.5], yticklabels=["differs", "ACT now", "ACT recorded"], ylim=(0, 3), xlabel="time (s)"
        )
        return as_svg(figure)

    def _bar(self, axis: Any, place: int, flags: Sequence[bool], colour: str) -> None:
        spans = [(start, end - start) for start, end in _runs(self._times_s, flags)]
        axis.broken_barh(spans, (place + 0.1, 0.8), color=colour)


def _runs(times_s: Sequence[float], flags: Sequence[bool]) -> list[tuple[float, float]]:
    """Begin and end of every run of ticks for which the flag stands."""
    runs: list[tuple[float, float]] = []
    begin: float | None = None
    for time_s, flag in zip(times_s, flags, strict=True):
        if flag and begin is None:
            begin = time_s
        elif not flag and begin is not None:
            runs.append((begin, time_s))
            begin = None
    if begin is not None:
        runs.append((begin, times_s[-1] + 0.04))
    return runs
