"""`hilbridge evaluate --data PATH`: the sections that the real annotations, gaze, packs and videos allow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from hilbridge.learning import metrics
from hilbridge.learning.data.egtea import load_actions
from hilbridge.learning.experiments import tables
from hilbridge.learning.experiments.annotated_history import evaluate_history
from hilbridge.learning.experiments.gaze_history import real_windows
from hilbridge.learning.experiments.report import Section, as_row, reliability_figure

Say = Callable[[str], None]


def real_sections(root: Path, say: Say) -> Sequence[Section]:
    """What the real annotations and whatever features are there allow."""
    actions = load_actions(root)  # a folder that is none is refused before anything is said
    histories = []
    for count in (3, 8):
        say(f"history model on the real annotations, {count} folds of 24/4/4 people")
        result = evaluate_history(actions, count)
        row = {name: value for name, value in as_row(result).items() if name != "top1_interval"}
        low, high = result.top1_interval
        histories.append({"model": f"history (annotated), {count} folds", **row, "top1_low": low, "top1_high": high})
    windows = real_windows(root, say=say)
    right = windows.logits.argmax(axis=1) == windows.labels
    what = f"{', '.join(windows.modalities)} of {windows.people} people, {windows.splits}"
    diagram = reliability_figure({str(method): (made, right) for method, made in windows.confidence.items()})
    return [
        Section(
            "history",
            "Next verb from the verbs before",
            "real",
            [*histories, {"model": "paper's GRU (gaze, hands, scene), 3 folds", "top1": 0.402, "top5": 0.699}],
            "People apart; temperature fitted on validation people. 3 folds are the paper's protocol, 8 test everybody once.",
        ),
        Section(
            "sensors_calibration",
            f"Real sensors, calibration: {what}",
            "real",
            [
                {
                    "method": str(method),
                    "windows": len(right),
                    "top1": float(right.mean()),
                    "ece15": metrics.ece(made, right),
                    "noise_floor": metrics.noise_floor(made),
                    "aurc": metrics.aurc(made, right),
                    "paper_ece15": tables.PAPER.get(str(method), {}).get("ece15"),
                }
                for method, made in windows.confidence.items()
            ],
            "Calibrators fitted on other people than they are judged on. With gaze alone a network hardly beats the most "
            "frequent verb and is hardly overconfident to begin with; a calibrator fitted on one person made it worse.",
            diagram,
        ),
        Section(
            "gaze_history",
            f"Real sensors with believed history: {what}",
            "real",
            [as_row(windows.summary())],
            "The history is what the system itself believed. gain: NLL, with its interval over people; an interval that "
            "reaches below 0 shows nothing. Most of any gain is the prior of the transitions (see marginal).",
        ),
    ]
