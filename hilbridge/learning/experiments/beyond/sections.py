"""Sections of the report that go beyond the paper's own, or set its recipe beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hilbridge.learning.experiments.beyond.estimators import (
    MARGIN,
    estimator_rows,
    estimators,
    threshold_rows,
    what_changes_what,
)
from hilbridge.learning.experiments.beyond.paper_folds import beside_the_paper, load_fold
from hilbridge.learning.experiments.report import Section
from hilbridge.learning.experiments.tables import Fold, Pooled


def estimator_sections(pooled: Pooled, ensemble: Sequence[Fold]) -> list[Section]:
    """At matched coverage, and at thresholds."""
    made = estimators(pooled, ensemble)
    return [
        Section(
            "estimators",
            "Estimators by what they change",
            "synthetic",
            estimator_rows(made, pooled.subject),
            what_changes_what(made)
            + "Spearman of confidence with being right, intervals of 95 % by subject. At matched "
            "coverage: share of windows on which an estimator acts or defers as temperature does; difference of act-only "
            "precision, paired by window, interval of 90 % by subject; equivalent where it lies within "
            f"{MARGIN:g} either way.",
        ),
        Section(
            "estimators_thresholds",
            "The same estimators at thresholds",
            "synthetic",
            threshold_rows(made),
            "At one threshold estimators act on different shares of the windows: most of what looks like precision is "
            "coverage.",
        ),
    ]


def paper_section(folds: Sequence[tuple[str, Path]]) -> Section:
    """Mean and deviation over folds of each recipe, of which the first is the paper's."""
    names = list(dict.fromkeys(name for name, _ in folds))
    paper, ours = ([load_fold(path) for name, path in folds if name == wanted] for wanted in names)
    return Section(
        "paper_recipe",
        "The paper's recipe, three folds, beside the paper",
        "synthetic",
        beside_the_paper(paper, ours),
        "24 / 4 / 4 simulated people a fold, calibrators fitted on the people by whom training stops, as in the paper; mean "
        "and standard deviation over folds, each with a seed of its own; best is the recipe of `train --data`. E5 counts "
        "every step of a stream, the paper windows before onsets.",
    )
