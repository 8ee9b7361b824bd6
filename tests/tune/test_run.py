"""`hilbridge tune` as a whole, the device's trials left out: what it reads, proposes, writes, and never does."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from hilbridge import cli
from hilbridge.errors import InputError
from hilbridge.intent.bundle import demo_bundle_path, load_bundle
from hilbridge.tune import run
from hilbridge.tune.device import Asked, Profiles
from hilbridge.tune.motion import Motion
from hilbridge.tune.run import Wish, tune

BUNDLE = load_bundle(demo_bundle_path())
FIGURES = {"left": 0.8, "distorted_deg": 0.3, "work_j": 0.01, "hand_mm": 5.0, "latched": False, "holds": True}
OLD = {"damping_mnms_rad": 3000, "damping_near_mnms_rad": 5000, "cap_mnm": 2000}
ROW = {"profile": "reach", "verbs": ["Take"], "old": OLD, "old_figures": FIGURES, "new_figures": FIGURES}
SAME = Profiles(({**ROW, "new": OLD},), "cap_mnm = 2000\n", "cap_mnm = 2000\n", "A6127E08", "A6127E08")
LESS = Profiles(
    ({**ROW, "new": {**OLD, "cap_mnm": 200}},), "cap_mnm = 2000\n", "cap_mnm = 200\n", "A6127E08", "01234567"
)


@pytest.fixture
def hand(tmp_path: Path) -> Path:
    path = tmp_path / "hand.csv"
    seconds = np.arange(0.0, 4.0, 0.01)
    table = np.column_stack([seconds, np.sin(30.0 * seconds), seconds * 0.0, seconds * 0.0])
    np.savetxt(path, table, delimiter=",", header="t_s,x,y,z", comments="")
    return path


def answering(monkeypatch: pytest.MonkeyPatch, profiles: Profiles) -> list[tuple[Asked, Sequence[Motion]]]:
    """In place of the device's part; keeps what it was asked."""
    asked: list[tuple[Asked, Sequence[Motion]]] = []

    def propose(what: Asked, motions: Sequence[Motion], progress: Callable[[int], Any]) -> Profiles:
        asked.append((what, motions))
        progress(1)()
        return profiles

    monkeypatch.setattr(run, "propose", propose)
    return asked


def no_bar(total: int) -> Callable[[], None]:
    return lambda: None


def test_nothing_to_change_is_no_diff(hand: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = answering(monkeypatch, SAME)
    found = tune(Wish((hand,), 0.5, Asked()), no_bar)
    assert found.diff == ""
    assert found.threshold.today == found.threshold.tau_on == BUNDLE.thresholds.tau_on
    assert [motion.name for motion in asked[0][1]] == ["hand.csv"]


def test_profiles_and_threshold_are_in_one_diff(hand: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answering(monkeypatch, LESS)
    config = tmp_path / "site.toml"
    config.write_text("[gate]\ntau_on = 0.5\ntau_off = 0.4\n")
    best = max(point.precision for point in BUNDLE.curve)
    found = tune(Wish((hand,), best - 1e-6, Asked(), config=config), no_bar)
    assert found.threshold.today == 0.5
    assert found.threshold.tau_on > 0.5
    assert "-cap_mnm = 2000\n+cap_mnm = 200\n" in found.diff
    assert f"-tau_on = 0.5\n+tau_on = {found.threshold.tau_on:g}\n" in found.diff
    assert "--- profiles.toml\n" in found.diff
    assert "--- site.toml\n" in found.diff
    told = json.loads(json.dumps(found.as_json(), allow_nan=False))
    assert told["hash"] == {"old": "A6127E08", "new": "01234567"}
    assert told["tau_on"]["old"] == 0.5
    assert told["diff"] == found.diff


def test_what_is_in_use_is_what_the_bridge_would_choose() -> None:
    assert run._today(0.7, 0.8, BUNDLE) == 0.7
    assert run._today(None, 0.85, BUNDLE) == BUNDLE.tau_for(0.85)
    assert run._today(None, 1.0, BUNDLE) == (BUNDLE.tau_for(1.0) or BUNDLE.thresholds.tau_on)
    assert run._today(None, None, BUNDLE) == BUNDLE.thresholds.tau_on


def test_the_command_prints_a_table_and_writes_the_diff(
    hand: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answering(monkeypatch, LESS)
    out = tmp_path / "tuned.diff"
    words = ["tune", str(hand), "--precision", "0.5", "--out", str(out)]
    done = CliRunner().invoke(cli.app, words)
    assert done.exit_code == 0, done.output
    assert "reach: cap, mN m" in done.output
    assert "profiles A6127E08 -> 01234567" in done.output
    assert out.read_text().startswith("Proposed by `hilbridge tune` for a wearer whom no recording names")
    again = CliRunner().invoke(cli.app, words)
    assert isinstance(again.exception, InputError)
    assert "is there already" in str(again.exception)
    assert CliRunner().invoke(cli.app, [*words, "--force", "--json"]).exit_code == 0


def test_without_a_file_the_diff_is_printed_and_json_is_one_object(hand: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answering(monkeypatch, LESS)
    done = CliRunner().invoke(cli.app, ["tune", str(hand), "--precision", "0.5"])
    assert "+cap_mnm = 200\n" in done.output
    done = CliRunner().invoke(cli.app, ["tune", str(hand), "--precision", "0.5", "--json"])
    assert json.loads(done.output)["profiles"][0]["new"]["cap_mnm"] == 200
    answering(monkeypatch, SAME)
    assert "nothing to change" in CliRunner().invoke(cli.app, ["tune", str(hand), "--precision", "0.5"]).output
