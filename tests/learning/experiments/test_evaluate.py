import csv
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import pytest

pytest.importorskip("torch")

from hilbridge.learning.experiments.benchmark import FoldShape, Plan
from hilbridge.learning.experiments.evaluate import evaluate
from hilbridge.learning.training.recipes import Recipe

TINY = Recipe(hidden=16, inner=8, epochs=2, windows_per_epoch=512, seed=1)
PLAN = Plan(
    training=3,
    validation=2,
    calibration=3,
    test=3,
    seconds=40.0,
    replayed=2,
    stream_seconds=20.0,
    recipe=TINY,
    overfit=replace(TINY, epochs=4, label_smoothing=0.0, learning_rate=1e-2),
    overfit_people=1,
    certificates=2,
    paper=FoldShape((replace(TINY, epochs=1), TINY), 40.0, 8, 2),
)
KEYS = {
    "targets",
    "e5_history",
    "baseline",
    "e1_calibration",
    "e1_overfit",
    "e2_ablation",
    "e2_overfit",
    "e2_curvature",
    "e3_selective",
    "e3_thresholds",
    "e3_verbs",
    "e4_runtime",
    "e5_closed_loop",
    "tremor",
    "comparators",
    "certificates",
    "estimators",
    "estimators_thresholds",
    "paper_recipe",
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
    gru, _, bayes = made.rows("baseline")[:3]
    assert gap["figure"] == pytest.approx(bayes["top1"] - gru["top1"])
    history = made.rows("e5_history")
    assert all(row["nll_with_history"] > 0 and 0 <= row["coverage"] <= 1 for row in history)
    costs = {row["what"]: row["p50_ms"] for row in made.rows("e4_runtime")}
    assert costs["MC dropout of all layers, 10 passes"] > costs["torch, one full window"]
    with pytest.raises(KeyError):
        made.rows("nothing")


def anybody_of_group(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.slow
@pytest.mark.parametrize("workers", ["1", "2"])
def test_ctrl_c_ends_workers_and_says_one_line(tmp_path, workers):
    streams = tmp_path / "out" / "work" / "streams"
    command = [sys.executable, "-m", "hilbridge.cli", "evaluate", "--out", str(tmp_path / "out"), "--workers", workers]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    while not list(streams.glob("*.npz")):
        assert process.poll() is None
        time.sleep(0.2)
    os.killpg(process.pid, signal.SIGINT)
    said = process.communicate(timeout=60)[1]
    assert process.returncode == 130
    assert said.splitlines()[-1] == "hilbridge: interrupted"
    assert "Traceback" not in said
    assert "Warning" not in said
    waited = 0
    while anybody_of_group(process.pid):
        waited += 1
        assert waited < 100, "a worker is left"
        time.sleep(0.1)
