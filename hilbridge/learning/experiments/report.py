"""One HTML page of tables and figures, and the same tables as CSV and JSON. No network, nothing outside the file."""

from __future__ import annotations

import base64
import csv
import html
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from numpy.typing import NDArray

from hilbridge.files import in_place_of, write_whole
from hilbridge.learning import metrics

matplotlib.use("Agg")
from matplotlib import pyplot as plt

plt.rcParams["text.parse_math"] = False  # a verb's name is shown as it is

Row = Mapping[str, Any]
STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; color: #1c2733; }
table { border-collapse: collapse; margin: .6rem 0 1.4rem; font-size: 13px; display: block; overflow-x: auto; }
th, td { border: 1px solid #cfd8e0; padding: .25rem .55rem; text-align: right; white-space: nowrap; }
th { background: #eef3f7; white-space: normal; vertical-align: bottom; } td:first-child, th:first-child { text-align: left; }
.real { border-left: 5px solid #2b7a4b; padding-left: .8rem; }
.synthetic { border-left: 5px solid #b8860b; padding-left: .8rem; }
img { max-width: 100%; } .note { color: #55626f; }
"""


@dataclass(frozen=True, slots=True)
class Section:
    """A titled table. origin: `synthetic` or `real`, said on the page; figure: PNG bytes or nothing."""

    key: str
    title: str
    origin: str
    rows: Sequence[Row]
    note: str = ""
    figure: bytes = b""


def write_report(folder: Path, title: str, sections: Sequence[Section], facts: Mapping[str, Any]) -> Path:
    """report.html, results.json and one CSV per section in `folder`. Returns the page's path."""
    folder.mkdir(parents=True, exist_ok=True)
    parts = [f"<!doctype html><meta charset=utf-8><title>{html.escape(title)}</title><style>{STYLE}</style>"]
    parts.append(f"<h1>{html.escape(title)}</h1>")
    parts.append(
        "<p>Sections with a yellow bar are figures from the <b>synthetic benchmark</b> (simulated wearers), those with a "
        "green bar from <b>real data</b>. The paper's figures stand beside them as a reference: they come from another data "
        "set (EGTEA Gaze+ with hand and scene features) and are not to be compared digit by digit.</p>"
    )
    parts.append("<p class=note>" + html.escape(", ".join(f"{key}: {value}" for key, value in facts.items())) + "</p>")
    for section in sections:
        parts.append(f'<section class="{section.origin}"><h2>{html.escape(section.title)}</h2>')
        parts.append(f"<p class=note>{html.escape(section.origin)}. {html.escape(section.note)}</p>")
        if section.figure:
            parts.append(f'<img src="data:image/png;base64,{base64.b64encode(section.figure).decode()}">')
        parts.append(_table(section.rows) + "</section>")
        _write_csv(folder / f"{section.key}.csv", section.rows)
    page = folder / "report.html"
    write_whole(page, "\n".join(parts))
    document = {
        "facts": dict(facts),
        "sections": {
            part.key: {"title": part.title, "origin": part.origin, "rows": list(part.rows)} for part in sections
        },
    }
    write_whole(folder / "results.json", json.dumps(_plain(document), indent=1))
    return page


def as_row(record: Any) -> dict[str, Any]:
    """A frozen record as a row of a table."""
    return {name: getattr(record, name) for name in record.__dataclass_fields__}


def columns(rows: Sequence[Row]) -> list[str]:
    """Every key of any row, in order of appearance."""
    return list(dict.fromkeys(key for row in rows for key in row))


def show(value: Any) -> str:
    """A cell as people read it."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    if isinstance(value, float):
        # Curvatures are tiny; an ECE of 0.0003 reads better as it stands.
        small = ".4f" if abs(value) >= 0.00005 else ".1e"
        return format(value, ".3f" if abs(value) >= 0.001 or value == 0.0 else small)
    return str(value)


def _table(rows: Sequence[Row]) -> str:
    names = columns(rows)
    head = "".join(f"<th>{html.escape(name.replace('_', ' '))}</th>" for name in names)
    body = "".join(
        "<tr>" + "".join(f"<td>{html.escape(show(row.get(name)))}</td>" for name in names) + "</tr>" for row in rows
    )
    return f"<table><tr>{head}</tr>{body}</table>"


def _write_csv(path: Path, rows: Sequence[Row]) -> None:
    with in_place_of(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=columns(rows) or ["nothing"])
        writer.writeheader()
        writer.writerows(_plain(list(rows)))


def _plain(value: Any) -> Any:
    """Only what JSON has; NaN becomes null."""
    if isinstance(value, Mapping):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _png(figure: Any) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, bbox_inches="tight")
    plt.close(figure)
    return buffer.getvalue()


def reliability_figure(curves: Mapping[str, tuple[NDArray[np.float64], NDArray[np.bool_]]]) -> bytes:
    """Reliability diagrams side by side; bar width says nothing, the dots' area says how many windows."""
    figure, axes = plt.subplots(1, len(curves), figsize=(3.4 * len(curves), 3.3), sharey=True, squeeze=False)
    for axis, (name, (confidence, right)) in zip(axes[0], curves.items(), strict=True):
        bins = metrics.reliability(confidence, right)
        size = np.array([part.count for part in bins])
        axis.plot([0, 1], [0, 1], color="#999", linewidth=1)
        axis.scatter(
            [b.confidence for b in bins], [b.accuracy for b in bins], s=12 + 240 * size / size.max(), alpha=0.7
        )
        axis.set(
            title=f"{name}\nECE15 {metrics.ece(confidence, right):.3f}", xlabel="confidence", xlim=(0, 1), ylim=(0, 1)
        )
    axes[0][0].set_ylabel("accuracy")
    return _png(figure)


def curve_figure(
    lines: Mapping[str, tuple[Sequence[float], Sequence[float]]],
    x: str,
    y: str,
    points: Mapping[str, tuple[float, float]],
) -> bytes:
    """Lines by name, single points by name."""
    figure, axis = plt.subplots(figsize=(5.2, 3.6))
    for name, (xs, ys) in lines.items():
        axis.plot(xs, ys, marker="o", markersize=3, label=name)
    for name, (px, py) in points.items():
        axis.scatter([px], [py], marker="x", color="k")
        axis.annotate(name, (px, py), (6, -3), textcoords="offset points", fontsize=7)
    axis.set(xlabel=x, ylabel=y)
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8)
    return _png(figure)
