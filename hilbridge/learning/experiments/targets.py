"""What the synthetic benchmark is held to, each figure beside its target: the first table of the report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hilbridge.learning.experiments.report import Row, Section


def target_section(sections: Sequence[Section]) -> Section:
    """Figures of the sections already made against their targets. `met` is computed, nothing is written by hand."""
    tables = {section.key: list(section.rows) for section in sections}
    rows: list[Row] = []

    def add(what: str, figure: float, low: float, high: float, target: str) -> None:
        rows.append({"what": what, "figure": figure, "target": target, "met": "yes" if low <= figure <= high else "NO"})

    gru, taught, bayes = tables["baseline"][:3]
    add("Top-1 short of Bayes", bayes["top1"] - gru["top1"], -1.0, 0.02, "<= 0.02")
    add("Top-1 short of what a network taught by Bayes reaches", taught["top1"] - gru["top1"], -1.0, 0.02, "<= 0.02")
    calibration = _by(tables["e1_calibration"], "method")
    overfit = _by(tables["e1_overfit"], "method")
    add("overfitted network, uncalibrated ECE15", overfit["none"]["ece15"], 0.3, 1.0, ">= 0.3")
    for method in ("temperature", "isotonic"):
        add(f"overfitted network, {method} ECE15", overfit[method]["ece15"], 0.0, 0.04, "<= 0.04")
        add(f"benchmark network, {method} ECE15", calibration[method]["ece15"], 0.0, 0.04, "<= 0.04")
    add("benchmark network, pooled isotonic ECE15", calibration["isotonic"]["ece15"], 0.0, 0.02, "<= 0.02")
    add("the same, debiased", calibration["isotonic"]["debiased_ece"], -0.01, 0.01, "|value| <= 0.01")
    for row in tables["e3_selective"]:
        if row["coverage"] in (0.5, 0.25):
            short = row["bayes"] - row["act_only_precision"]
            add(f"act-only precision at coverage {row['coverage']} short of Bayes", short, -1.0, 0.02, "<= 0.02")
    for key, network in (("e2_ablation", "benchmark"), ("e2_overfit", "overfitted")):
        for row in tables[key]:
            if "ratio" in row and row["lost"] != "nothing":
                what = f"{network} network, {row['lost']} lost: ECE15 of its own calibrator over one global temperature"
                add(what, row["ratio"], 0.0, 0.7, "<= 0.7")
    for row in tables["e5_closed_loop"]:
        if row["method"] == "gate" and row["tau_on"] >= 0.5 and row["coverage"] >= 0.01:
            what = f"closed loop at tau_on {row['tau_on']:g}"
            reached, claimed = row["act_only_precision"], row["mean_confidence_while_acting"]
            add(f"{what}: act-only precision less tau_on", reached - row["tau_on"], -0.02, 1.0, ">= -0.02")
            add(f"{what}: claimed less reached", claimed - reached, -0.03, 0.03, "|value| <= 0.03")
    calm = next(row for row in tables["tremor"] if row["guard"] == "on" and row["tremor_hz"] == 0.0)
    for row in tables["tremor"]:
        if row["guard"] == "on" and row["tremor_hz"] > 0.0:
            what = f"tremor of {row['tremor_hz']:g} Hz"
            add(f"{what}: coverage", row["coverage"], 0.3 * calm["coverage"], 1.0, "0.3 of calm people's")
            if row["act_only_precision"] is not None:
                least = row["tau_on"] - 0.05
                add(f"{what}: act-only precision", row["act_only_precision"], least, 1.0, f">= {least:.2f}")
    return Section(
        "targets", "Targets of the synthetic benchmark", "synthetic", rows, "Details are in the sections below."
    )


def _by(rows: Sequence[Row], key: str) -> Mapping[str, Row]:
    return {str(row[key]): row for row in rows}
