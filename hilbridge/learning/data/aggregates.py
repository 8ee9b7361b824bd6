"""Aggregate statistics of the real annotations that the simulated wearer lives by (no row of the data is kept).

`python -m hilbridge.learning.data.aggregates FOLDER > hilbridge/wearer/statistics.json` makes the committed file again.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from hilbridge.learning.data.egtea import Action, by_session, load_actions
from hilbridge.verbs import VERBS

QUANTILES = [0.05, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95]


def aggregate(actions: Sequence[Action]) -> dict[str, object]:
    """Transition counts (row: previous verb), first verbs, duration and gap quantiles in ms per (previous) verb."""
    count = len(VERBS)
    transitions = np.zeros((count, count), dtype=int)
    first = np.zeros(count, dtype=int)
    durations: list[list[int]] = [[] for _ in VERBS]
    gaps: list[list[int]] = [[] for _ in VERBS]
    for session in by_session(actions).values():
        first[session[0].label] += 1
        for action in session:
            durations[action.label].append(action.end_ms - action.start_ms)
        for before, after in pairwise(session):
            transitions[before.label, after.label] += 1
            # Overlapping annotations mean that the next action began at once.
            gaps[before.label].append(max(0, after.start_ms - before.end_ms))
    return {
        "source": "aggregated from the EGTEA Gaze+ action annotations: 15,484 actions, 86 sessions, 32 subjects",
        "verbs": list(VERBS),
        "quantiles": QUANTILES,
        "first": first.tolist(),
        "transitions": transitions.tolist(),
        "duration_ms": [np.quantile(values, QUANTILES).round().astype(int).tolist() for values in durations],
        "gap_ms": [np.quantile(values, QUANTILES).round().astype(int).tolist() for values in gaps],
    }


def main(arguments: Sequence[str]) -> int:
    """Write the JSON to standard output."""
    lines = [f'  "{key}": {json.dumps(value)}' for key, value in aggregate(load_actions(Path(arguments[0]))).items()]
    sys.stdout.write("{\n" + ",\n".join(lines) + "\n}\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
