"""One HTML page per scenario: verdicts, then confidence, gate, device, torque and faults on one time axis."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import jinja2
import markupsafe
import numpy as np

from hilbridge.files import write_whole
from hilbridge.observe.report import STATE_COLOURS, as_svg, plotter
from hilscenario.format.files import dump_scenario
from hilscenario.signals.trace import Trace
from hilscenario.verdict.outcome import Run
from hilscenario.world.parts import parts_of

_PALETTE = ("#d1495b", "#e76f51", "#b8a1d9", "#457b9d", "#6c757d", "#bc6c25")


def write_page(run: Run, path: Path) -> Path:
    """Write the page; gives its path."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("hilscenario.verdict"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    page = environment.get_template("scenario.html").render(
        result=run.result,
        scenario=run.scenario,
        source=dump_scenario(run.scenario),
        timeline=markupsafe.Markup(_timeline(run)),
    )
    return write_whole(path, page)


def _timeline(run: Run) -> str:
    plt = plotter()
    trace = run.trace
    seconds = np.arange(trace.length) * trace.step_ms / 1000.0
    figure, (confidence, gate, device, torque, fault) = plt.subplots(
        5, 1, figsize=(11, 8), sharex=True, height_ratios=[3, 0.8, 0.8, 2.2, 1.4], layout="constrained"
    )
    gates = parts_of(run.scenario).gate
    confidence.plot(seconds, trace["gate.confidence"], color="#1d3557", lw=1.2, label="smoothed confidence")
    confidence.axhline(gates.tau_on, color="#d1495b", lw=1, label=f"tau_on = {gates.tau_on:.2f}")
    confidence.axhline(gates.tau_off, color="#d1495b", lw=1, ls=":", label=f"tau_off = {gates.tau_off:.2f}")
    confidence.set(ylim=(0, 1.02), ylabel="confidence")
    confidence.legend(loc="upper right", fontsize=8, ncols=3)
    for begin, end in _spans(np.asarray(trace["gate.act"], float) != 0.0):
        right = bool(trace["gate.right"][begin])
        gate.axvspan(seconds[begin], seconds[end], color="#2a9d5c" if right else "#f4a261", lw=0)
    gate.set(yticks=[0.5], yticklabels=["ACT"], ylim=(0, 1))
    _states(device, trace, seconds)
    torque.plot(seconds, trace["device.assist_nm"], color="#2a9d5c", lw=1, label="assist")
    torque.plot(seconds, trace["device.gravity_nm"], color="#457b9d", lw=1, label="gravity support")
    torque.set(ylabel="torque (N m)")
    torque.legend(loc="upper right", fontsize=8, ncols=2)
    names = [name for name in trace.values if name.startswith("fault.") and name != "fault.any"]
    for row, name in enumerate(names):
        for begin, end in _spans(np.asarray(trace[name], float) != 0.0):
            fault.axvspan(
                seconds[begin],
                max(seconds[end], seconds[begin] + 0.004 * seconds[-1]),
                row / len(names),
                (row + 0.8) / len(names),
                color=_PALETTE[row % len(_PALETTE)],
                lw=0,
            )
    rows = max(1, len(names))
    fault.set(
        ylim=(0, 1),
        yticks=[(row + 0.4) / rows for row in range(len(names))],
        yticklabels=[name.removeprefix("fault.") for name in names],
        xlabel="time (s)",
        xlim=(0, seconds[-1]),
    )
    for judgement in run.result.judgements:
        if not judgement.holds and judgement.at_ms is not None:
            for axis in (confidence, gate, device, torque, fault):
                axis.axvline(judgement.at_ms / 1000.0, color="#8b0000", lw=1.5, ls="--")
            torque.annotate(
                judgement.name[:48],
                (judgement.at_ms / 1000.0, 0.0),
                fontsize=7,
                color="#8b0000",
                xytext=(4, 12),
                textcoords="offset points",
            )
    return as_svg(figure)


def _states(axis: Any, trace: Trace, seconds: Any) -> None:
    from matplotlib.patches import Rectangle

    states = trace["device.state"]
    shown: list[str] = []
    edges = [0, *(np.flatnonzero(states[1:] != states[:-1]) + 1), len(states)]
    for begin, end in itertools.pairwise(edges):
        state = str(states[begin])
        axis.axvspan(
            seconds[begin], seconds[min(end, len(seconds) - 1)], color=STATE_COLOURS.get(state, "#000000"), lw=0
        )
        if state not in shown:
            shown.append(state)
    axis.set(yticks=[0.5], yticklabels=["device"], ylim=(0, 1))
    handles = [Rectangle((0, 0), 1, 1, color=STATE_COLOURS.get(state, "#000000")) for state in shown]
    axis.legend(handles, shown, loc="upper right", fontsize=7, ncols=9, framealpha=0.9)


def _spans(level: Any) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([False], level, [False])).astype(int)))
    return [(int(begin), min(int(end), len(level) - 1)) for begin, end in edges.reshape(-1, 2)]
