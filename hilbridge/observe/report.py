"""One HTML page per recording: figures first, then what happened when. It needs no network and no script to be read."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
import markupsafe

from hilbridge.observe.recording import Row, read_recording
from hilbridge.observe.summary import Summary, summarise

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


def write_report(recording: Path, target: Path) -> Summary:
    """Read a recording, write its page to `target`, return its summary. Raises InputError on a broken recording."""
    rows = list(read_recording(recording))
    summary = summarise(rows)
    meta = next((row.data for row in rows if row.topic == "/meta"), {})
    events = [row for row in rows if row.topic == "/event"]
    ticks = [row for row in rows if row.topic == "/tick"]
    start_ns = ticks[0].time_ns if ticks else 0
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("hilbridge.observe"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    page = environment.get_template("report.html").render(
        title=recording.name,
        meta=meta,
        summary=summary,
        events=[((row.time_ns - start_ns) / 1e9, row.data) for row in events],
        holds=list(summary.hold_reasons.items())[:_MAX_HOLD_ROWS],
        timeline=markupsafe.Markup(timeline_svg(rows, meta)) if ticks else "",
        latency=markupsafe.Markup(latency_svg(ticks)) if ticks else "",
    )
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(page, encoding="utf-8")
    return summary


def timeline_svg(rows: Sequence[Row], meta: dict[str, Any]) -> str:
    """Confidence against its thresholds, the gate, the device's state and its torque, on one time axis."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.patches import Rectangle

    ticks = [row for row in rows if row.topic == "/tick"]
    states = [row for row in rows if row.topic == "/device" and "state" in row.data]
    torques = [row for row in rows if row.topic == "/device" and "assist_nm" in row.data]
    start_ns = ticks[0].time_ns
    figure, (top, gate, device, torque) = plt.subplots(
        4, 1, figsize=(11, 7), sharex=True, height_ratios=[3, 0.9, 0.7, 2], layout="constrained"
    )
    seconds = [(row.time_ns - start_ns) / 1e9 for row in ticks]
    top.plot(seconds, [row.data["confidence"] for row in ticks], color="#1d3557", lw=1.2, label="smoothed confidence")
    for name, style in (("tau_on", "-"), ("tau_off", ":")):
        if name in meta:
            top.axhline(meta[name], color="#d1495b", ls=style, lw=1, label=f"{name} = {meta[name]:.2f}")
    top.set(ylim=(0, 1.02), ylabel="confidence")
    top.legend(loc="upper right", fontsize=8, ncols=3)

    for (begin_s, end_s), data in _runs(ticks, start_ns, ("action", "verb", "right")):
        if data["action"] == "ACT":
            wrong = data.get("right") is False
            gate.axvspan(begin_s, end_s, 0.5, 1.0, color="#d1495b" if wrong else "#2a9d5c", lw=0)
    for (begin_s, end_s), data in _runs(ticks, start_ns, ("truth",)):
        if data.get("truth") and end_s - begin_s > 0.4:
            gate.axvspan(begin_s, end_s, 0.02, 0.44, color="#e5e9f0", lw=0)
            gate.text((begin_s + end_s) / 2, 0.23, data["truth"], fontsize=6, ha="center", va="center", clip_on=True)
    gate.set(ylim=(0, 1), yticks=[0.23, 0.75], yticklabels=["wearer", "gate"])

    for (begin_s, end_s), data in _runs(states, start_ns, ("state",)):
        device.axvspan(begin_s, end_s, color=STATE_COLOURS.get(data["state"], "#000000"), lw=0)
    device.set(yticks=[], ylabel="device", ylim=(0, 1))
    shown = {row.data["state"] for row in states}
    handles = [Rectangle((0, 0), 1, 1, color=colour) for state, colour in STATE_COLOURS.items() if state in shown]
    device.legend(
        handles, [s for s in STATE_COLOURS if s in shown], loc="upper right", fontsize=7, ncols=9, framealpha=0.9
    )

    moments = [(row.time_ns - start_ns) / 1e9 for row in torques]
    torque.plot(moments, [row.data["assist_nm"] for row in torques], color="#2a9d5c", lw=1, label="assist")
    torque.plot(moments, [row.data["gravity_nm"] for row in torques], color="#457b9d", lw=1, label="gravity support")
    torque.set(ylabel="torque (N m)", xlabel="time (s)", xlim=(0, max(seconds[-1], 0.1)))
    torque.legend(loc="upper right", fontsize=8, ncols=2)
    return as_svg(figure)


def latency_svg(ticks: Sequence[Row]) -> str:
    """Distribution of the time from the picture's capture to its ACT_CMD."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    values = [row.data["latency_ms"] for row in ticks if row.data.get("latency_ms") is not None]
    figure, axis = plt.subplots(figsize=(5.2, 2.6), layout="constrained")
    axis.hist(values, bins=40, color="#457b9d")
    axis.axvline(150, color="#d1495b", lw=1)
    axis.set(xlabel="capture to ACT_CMD (ms); red: limit of 150 ms", ylabel="ticks", xlim=(0, 160))
    return as_svg(figure)


def _runs(
    rows: Sequence[Row], start_ns: int, keys: tuple[str, ...]
) -> list[tuple[tuple[float, float], dict[str, Any]]]:
    """Spans of time over which the named values stay the same."""
    spans: list[tuple[tuple[float, float], dict[str, Any]]] = []
    begin = 0
    for index in range(1, len(rows) + 1):
        if index == len(rows) or any(rows[index].data.get(k) != rows[begin].data.get(k) for k in keys):
            end_ns = rows[min(index, len(rows) - 1)].time_ns
            spans.append((((rows[begin].time_ns - start_ns) / 1e9, (end_ns - start_ns) / 1e9), rows[begin].data))
            begin = index
    return spans


def as_svg(figure: Any) -> str:
    import matplotlib.pyplot as plt

    out = io.StringIO()
    figure.savefig(out, format="svg", metadata={"Date": None})
    plt.close(figure)
    text = out.getvalue()
    return text[text.index("<svg") :]
