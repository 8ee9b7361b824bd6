"""One HTML page per recording: figures first, then what happened when. It needs no network and no script to be read."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from operator import attrgetter
from pathlib import Path
from typing import Any, TypeVar

import jinja2
import markupsafe

from hilbridge.files import write_whole
from hilbridge.observe.reading import read_recording
from hilbridge.observe.summary import Summary, summarise
from hilbridge.records import Action
from hilbridge.rows import CountersRow, DeviceRow, EventRow, MetaRow, SensorsRow, TickRow

R = TypeVar("R", TickRow, DeviceRow)

STATE_COLOURS = {
    "Boot": "#c9ced6",
    "SelfTest": "#c9ced6",
    "Follow": "#8ecae6",
    "Ready": "#bde0c4",
    "Assist": "#2a9d5c",
    "RampDown": "#f4c95d",
    "Passive": "#b8a1d9",
    "Latched": "#d1495b",
    "EStop": "#8b0000",
}
_MAX_HOLD_ROWS = 12


_TOPICS = (MetaRow.topic, TickRow.topic, DeviceRow.topic, EventRow.topic, SensorsRow.topic, CountersRow.topic)


def write_report(recording: Path | Sequence[Path], target: Path) -> Summary:
    """Read a recording, write its page to `target`, return its summary. Raises InputError on what is no recording.

    One that was cut off is read up to there; page and summary say what is missing.
    """
    reader = read_recording(recording, _TOPICS)
    rows = list(reader)
    summary = replace(summarise(rows), missing=reader.missing)
    meta = next((row for row in rows if isinstance(row, MetaRow)), MetaRow(0))
    events = [row for row in rows if isinstance(row, EventRow)]
    ticks = [row for row in rows if isinstance(row, TickRow)]
    devices = [row for row in rows if isinstance(row, DeviceRow)]
    start_ns = ticks[0].time_ns if ticks else 0
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("hilbridge.observe"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    page = environment.get_template("report.html").render(
        title=reader.path.name,
        heading=meta.title or meta.scenario or "A run of hilbridge",
        meta={name: value for name, value in asdict(meta).items() if value is not None and name != "time_ns"},
        summary=summary,
        events=[((row.time_ns - start_ns) / 1e9, row.text) for row in events],
        holds=list(summary.hold_reasons.items())[:_MAX_HOLD_ROWS],
        timeline=markupsafe.Markup(timeline_svg(ticks, devices, meta)) if ticks else "",
        latency=markupsafe.Markup(latency_svg(ticks)) if ticks else "",
    )
    write_whole(target, page)
    return summary


def plotter() -> Any:
    """matplotlib's pyplot for a process without a display. Names are shown as they are: `$` begins no formula in them."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams["text.parse_math"] = False
    from matplotlib import pyplot

    return pyplot


def timeline_svg(ticks: Sequence[TickRow], devices: Sequence[DeviceRow], meta: MetaRow) -> str:
    """Confidence against its thresholds, the gate, the device's state and its torque, on one time axis."""
    plt = plotter()
    start_ns = ticks[0].time_ns
    figure, (top, gate, device, torque) = plt.subplots(
        4, 1, figsize=(11, 7), sharex=True, height_ratios=[3, 0.9, 0.7, 2], layout="constrained"
    )
    seconds = [(row.time_ns - start_ns) / 1e9 for row in ticks]
    top.plot(seconds, [row.confidence for row in ticks], color="#1d3557", lw=1.2, label="smoothed confidence")
    for name, tau, style in (("tau_on", meta.tau_on, "-"), ("tau_off", meta.tau_off, ":")):
        if tau is not None:
            top.axhline(tau, color="#d1495b", ls=style, lw=1, label=f"{name} = {tau:.2f}")
    top.set(ylim=(0, 1.02), ylabel="confidence")
    top.legend(loc="upper right", fontsize=8, ncols=3)
    _draw_gate(gate, ticks, start_ns)
    _draw_states(device, devices, start_ns)
    measured = [row for row in devices if row.assist_nm is not None]
    moments = [(row.time_ns - start_ns) / 1e9 for row in measured]
    torque.plot(moments, [row.assist_nm for row in measured], color="#2a9d5c", lw=1, label="assist")
    torque.plot(moments, [row.gravity_nm for row in measured], color="#457b9d", lw=1, label="gravity support")
    torque.set(ylabel="torque (N m)", xlabel="time (s)", xlim=(0, max(seconds[-1], 0.1)))
    torque.legend(loc="upper right", fontsize=8, ncols=2)
    return as_svg(figure)


def _draw_gate(axis: Any, ticks: Sequence[TickRow], start_ns: int) -> None:
    """ACT above, green where it is right and red where it is wrong; the wearer's own verb below."""
    for (begin_s, end_s), tick in _runs(ticks, start_ns, attrgetter("action", "verb", "right")):
        if tick.action is Action.ACT:
            axis.axvspan(begin_s, end_s, 0.5, 1.0, color="#d1495b" if tick.right is False else "#2a9d5c", lw=0)
    for (begin_s, end_s), tick in _runs(ticks, start_ns, attrgetter("truth")):
        if tick.truth and end_s - begin_s > 0.4:
            axis.axvspan(begin_s, end_s, 0.02, 0.44, color="#e5e9f0", lw=0)
            axis.text((begin_s + end_s) / 2, 0.23, tick.truth, fontsize=6, ha="center", va="center", clip_on=True)
    axis.set(ylim=(0, 1), yticks=[0.23, 0.75], yticklabels=["wearer", "gate"])


def _draw_states(axis: Any, devices: Sequence[DeviceRow], start_ns: int) -> None:
    from matplotlib.patches import Rectangle

    for (begin_s, end_s), row in _runs(devices, start_ns, attrgetter("state")):
        axis.axvspan(begin_s, end_s, color=STATE_COLOURS.get(row.state, "#000000"), lw=0)
    axis.set(yticks=[], ylabel="device", ylim=(0, 1))
    seen = {row.state for row in devices}
    shown = [state for state in STATE_COLOURS if state in seen]
    handles = [Rectangle((0, 0), 1, 1, color=STATE_COLOURS[state]) for state in shown]
    axis.legend(handles, shown, loc="upper right", fontsize=7, ncols=9, framealpha=0.9)


def latency_svg(ticks: Sequence[TickRow]) -> str:
    """Distribution of the time from the picture's capture to its ACT_CMD."""
    plt = plotter()
    values = [row.latency_ms for row in ticks if row.latency_ms is not None]
    figure, axis = plt.subplots(figsize=(5.2, 2.6), layout="constrained")
    axis.hist(values, bins=40, color="#457b9d")
    axis.axvline(150, color="#d1495b", lw=1)
    axis.set(xlabel="capture to ACT_CMD (ms); red: limit of 150 ms", ylabel="ticks", xlim=(0, 160))
    return as_svg(figure)


def _runs(rows: Sequence[R], start_ns: int, key: Callable[[R], object]) -> list[tuple[tuple[float, float], R]]:
    """Spans of time (begin and end in s) over which the key stays the same, each with its first row."""
    spans: list[tuple[tuple[float, float], R]] = []
    begin = 0
    for index in range(1, len(rows) + 1):
        if index == len(rows) or key(rows[index]) != key(rows[begin]):
            end_ns = rows[min(index, len(rows) - 1)].time_ns
            spans.append((((rows[begin].time_ns - start_ns) / 1e9, (end_ns - start_ns) / 1e9), rows[begin]))
            begin = index
    return spans


def as_svg(figure: Any) -> str:
    import matplotlib.pyplot as plt

    out = io.StringIO()
    figure.savefig(out, format="svg", metadata={"Date": None})
    plt.close(figure)
    text = out.getvalue()
    return text[text.index("<svg") :]
