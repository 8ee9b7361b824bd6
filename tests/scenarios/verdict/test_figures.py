"""A recording's report says what the engine said: each scenario of the catalogue, through the reader of recordings."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from hilbridge.observe.reading import read_recording
from hilbridge.observe.summary import summarise
from hilscenario.format.collect import collect
from hilscenario.format.schema import Scenario
from hilscenario.lockstep.run import run_scenario

CATALOG = Path(__file__).parents[3] / "scenarios" / "catalog"
FOUND = list(collect([CATALOG]))


@pytest.mark.parametrize("scenario", [one for _, one in FOUND], ids=[one.name for _, one in FOUND])
def test_the_report_of_a_recording_gives_the_figures_of_the_engine(scenario: Scenario, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    figures = run_scenario(scenario, recording=path).result.figures
    summary = summarise(read_recording(path))
    precision = summary.act_only_precision
    assert (summary.acts, summary.holds) == (figures["acts"], figures["holds"])
    assert summary.coverage == figures["coverage"]
    assert (
        math.isnan(figures["act_only_precision"]) if precision is None else precision == figures["act_only_precision"]
    )
    assert (summary.false_assists_per_min or 0.0) == figures["false_assists_per_min"]
    # The engine counts the device's ticks, which begin after its rows; its clock may be off by some parts per million.
    assert summary.assist_s == pytest.approx(figures["assist_s"], rel=2e-3, abs=0.002)
    assert summary.frames_lost == figures["frames_lost"]
    assert summary.frames_sent > 0
    assert summary.frames_received > 0
