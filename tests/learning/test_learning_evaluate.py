import csv
import json
from dataclasses import replace

import pytest

pytest.importorskip("torch")

from hilbridge.learning.evaluate import evaluate
from hilbridge.learning.experiments import Plan
from hilbridge.learning.train import Recipe

TINY = Recipe(hidden=16, inner=8, epochs=2, windows_per_epoch=512, seed=1)
PLAN = Plan(
    training=3,
    validation=2,
    test=3,
    seconds=40.0,
    replayed=2,
    stream_seconds=20.0,
    recipe=TINY,
    overfit=replace(TINY, epochs=4, label_smoothing=0.0, learning_rate=1e-2),
    overfit_people=1,
    certificates=2,
)
KEYS = {
    "targets",
    "e5_history",
    "baseline",
    "e1_calibration",
    "e1_overfit",
    "e2_ablation",
    "e2_curvature",
    "e3_selective",
    "e3_thresholds",
    "e3_verbs",
    "e4_runtime",
    "e5_closed_loop",
    "tremor",
    "comparators",
    "certificates",
}


@pytest.mark.slow
def test_the_whole_evaluation_runs_small_and_says_where_its_figures_come_from(tmp_path):
    said = []
    made = evaluate("synthetic", tmp_path / "out", PLAN, workers=1, comparators=False, say=said.append)
    page = made.report.read_text(encoding="utf-8")
    assert "synthetic benchmark" in page
    assert "another data set" in page
    assert page.count('<section class="synthetic">') == len(KEYS)
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert set(results["sections"]) == KEYS
    for key in KEYS:
        with (tmp_path / "out" / f"{key}.csv").open() as file:
            assert len(list(csv.DictReader(file))) == len(results["sections"][key]["rows"])
    top1 = {row["method"]: row["top1"] for row in made.rows("e1_calibration")}
    assert len(set(top1.values())) == 1, "a calibrator changed labels"
    assert {row["lost"] for row in made.rows("e2_ablation")} >= {"nothing", "gaze", "hands", "scene"}
    assert any("networks" in line for line in said)
    targets = made.rows("targets")
    assert {row["met"] for row in targets} <= {"yes", "NO"}
    gap = next(row for row in targets if row["what"] == "Top-1 short of Bayes")
    gru, bayes = made.rows("baseline")[:2]
    assert gap["figure"] == pytest.approx(bayes["top1"] - gru["top1"])
    history = made.rows("e5_history")
    assert all(row["nll_with_history"] > 0 and 0 <= row["coverage"] <= 1 for row in history)
    costs = {row["what"]: row["p50_ms"] for row in made.rows("e4_runtime")}
    assert costs["MC dropout of all layers, 10 passes"] > costs["torch, one full window"]
    with pytest.raises(KeyError):
        made.rows("nothing")
