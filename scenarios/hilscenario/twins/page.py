"""Twins on paper: a table of the worst of each event, and a picture of each pair."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from hilbridge.files import in_place_of, write_whole
from hilbridge.observe.report import plotter
from hilscenario.twins.run import STEP_S, Difference, Pair, Trace, begins_ms

Row = tuple[Pair, Difference]
TITLES = ("event", "pairs", "work J", "hand mm", "drop mm", "torque N m", "tremor", "latched")


def worst(rows: Sequence[Row]) -> list[tuple[str, ...]]:
    """A line an event: the largest of every figure; tremor as smallest to largest."""
    made: list[tuple[str, ...]] = []
    for event in dict.fromkeys(pair.event for pair, _ in rows):
        of = [found for pair, found in rows if pair.event == event]
        made.append(
            (
                event,
                str(len(of)),
                f"{max(one.work_j for one in of):.4f}",
                f"{max(one.hand_mm for one in of):.1f}",
                f"{max(one.drop_mm for one in of):.1f}",
                f"{max(one.torque_nm for one in of):.2f}",
                f"{min(one.tremor for one in of):.2f} to {max(one.tremor for one in of):.2f}",
                str(sum(one.latched for one in of)),
            )
        )
    return made


def as_json(rows: Sequence[Row]) -> str:
    """Every pair with what differs."""
    return json.dumps(
        [
            {
                "event": pair.event,
                "verb": pair.verb,
                "seed": pair.seed,
                "control": pair.body.control,
                "tremor_kind": pair.body.tremor,
                "preset": pair.body.preset,
                **asdict(found),
            }
            for pair, found in rows
        ],
        indent=1,
    )


def draw(pair: Pair, run: Trace, twin: Trace, path: Path) -> None:
    """Elbow, hand and added torque of both runs on one time axis."""
    plt = plotter()
    figure, (elbow, hand, torque) = plt.subplots(3, 1, figsize=(9, 6), sharex=True, layout="constrained")
    seconds = np.arange(len(run.elbow)) * STEP_S
    for trace, colour, name in ((twin, "#6c757d", "twin"), (run, "#d1495b", pair.event)):
        elbow.plot(seconds, np.degrees(trace.elbow), color=colour, lw=1.0, label=name)
        torque.plot(seconds, trace.added_nm, color=colour, lw=1.0)
    apart = 1e3 * (np.array(run.hand) - np.array(twin.hand))
    hand.plot(seconds, apart[:, 0], color="#457b9d", lw=1.0, label="forwards")
    hand.plot(seconds, apart[:, 1], color="#e76f51", lw=1.0, label="up")
    elbow.axvline(begins_ms(pair.action) * STEP_S, color="black", lw=0.6)
    elbow.set_ylabel("elbow, degrees")
    hand.set_ylabel("hand, mm from twin")
    torque.set_ylabel("added, N m")
    torque.set_xlabel(f"s; {pair.verb}, {pair.body.control}, {pair.body.tremor}, {pair.body.preset}, seed {pair.seed}")
    elbow.legend()
    hand.legend()
    with in_place_of(path) as partial:
        figure.savefig(partial, format="png", dpi=90)
    plt.close(figure)


def write(rows: Sequence[Row], out: Path) -> None:
    """`twins.json` in the folder."""
    write_whole(out / "twins.json", as_json(rows))
