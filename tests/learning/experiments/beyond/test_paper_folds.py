"""Folds of the paper's recipe: subject-disjoint, and a table of means and deviations beside the paper's figures."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

pytest.importorskip("torch")

from hilbridge.learning.data.stream import Stream
from hilbridge.learning.experiments.beyond.paper_folds import beside_the_paper, folds_of, paper_rows
from hilbridge.verbs import VERBS


def test_folds_are_24_4_4_and_nobody_is_tested_twice() -> None:
    folds = folds_of(32, 4)
    assert [tuple(len(part) for part in fold) for fold in folds] == [(24, 4, 4)] * 3
    for training, stopping, test in folds:
        assert len({*training, *stopping, *test}) == 32
    for one, other in combinations(folds, 2):
        assert not set(one[2]) & set(other[2])


def drawn(seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    made = {}
    for part, count in (("stop", 600), ("test", 800)):
        labels = rng.integers(0, len(VERBS), count)
        logits = rng.normal(size=(count, len(VERBS)))
        logits[np.arange(count), labels] += 2.0
        made |= {f"{part}_logits": 3.0 * logits, f"{part}_label": labels, f"{part}_subject": np.repeat(0, count)}
    steps, verb = 1_000, np.repeat(np.arange(20) % 4, 50)
    nothing = np.full(steps, -1)
    stream = Stream(
        np.zeros(steps, int), np.zeros((steps, 1), np.float32), np.ones((steps, 3), bool), verb, verb, verb, nothing,
        nothing, np.zeros((steps, len(VERBS)), np.float32), np.ones(steps, bool),
    )  # fmt: skip
    logits = rng.normal(size=(steps, len(VERBS)))
    logits[np.arange(steps), verb] += 6.0
    return (
        made
        | {f"stream_{name}": getattr(stream, name) for name in Stream.__dataclass_fields__}
        | {"stream_logits": logits}
    )


def test_the_table_has_the_papers_rows_with_mean_and_deviation() -> None:
    rows = {row["what"]: row for row in paper_rows([drawn(seed) for seed in range(3)])}
    assert rows["none: ece15"]["paper"] == 0.403
    assert rows["temperature: nll"]["paper"] == 2.22
    assert rows["isotonic: ece15"]["paper"] == 0.039
    assert "isotonic: nll" not in rows
    assert rows["act-only precision at coverage 0.25"]["paper"] == 0.80
    assert rows["closed loop at tau 0.5, temperature: act-only precision"]["paper"] == 0.80
    assert rows["none: top1"]["mean"] == rows["isotonic: top1"]["mean"]
    assert rows["none: ece15"]["mean"] > rows["temperature: ece15"]["mean"]  # logits of three times their worth
    assert all(row["folds"] == 3 and row["deviation"] >= 0.0 for row in rows.values())
    both = beside_the_paper([drawn(0)], [drawn(1)])
    assert all(row["best_mean"] >= 0.0 and row["best_deviation"] is None for row in both)
    assert 0.5 < rows["closed loop at tau 0.5, temperature: act-only precision"]["mean"] <= 1.0
