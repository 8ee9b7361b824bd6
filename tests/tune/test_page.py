"""What tuning came to, for people: a table, a configuration with another tau_on, a diff that patch takes."""

from __future__ import annotations

import subprocess
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hilbridge.intent.bundle import Replayed
from hilbridge.tune.device import Profiles
from hilbridge.tune.motion import Motion
from hilbridge.tune.page import config_with, diff_of, rows_of, to_sign
from hilbridge.tune.threshold import Own, Threshold

OLD = {"damping_mnms_rad": 3000, "damping_near_mnms_rad": 5000, "cap_mnm": 2000}
FIGURES = {"left": 0.8, "distorted_deg": 0.3, "work_j": 0.01, "hand_mm": 5.0}
BETTER = {"left": 0.6, "distorted_deg": 0.2, "work_j": 0.005, "hand_mm": 4.0}
POINT = Replayed(0.7, 0.85, 0.3, 20.0, 0.85, 0.1)
THRESHOLD = Threshold(0.7, 0.8, 0.9, POINT, POINT._replace(precision=0.92, coverage=0.2), None, None, "lowest")


def profiles(*rows: dict[str, Any]) -> Profiles:
    return Profiles(rows, "a = 1\n", "a = 2\n", "A6127E08", "0123ABCD")


def row(name: str, new: dict[str, int] | None, figures: dict[str, float] | None = None) -> dict[str, Any]:
    return {"profile": name, "old": OLD, "new": new, "old_figures": FIGURES, "new_figures": figures or BETTER}


def test_the_table_says_old_new_and_what_it_buys() -> None:
    rows = rows_of(
        THRESHOLD,
        profiles(
            row("reach", {**OLD, "damping_mnms_rad": 1500, "cap_mnm": 200}),
            row("pour", {**OLD, "cap_mnm": 500}),
            row("cut", OLD, FIGURES),
            row("mix", None),
        ),
    )
    gains = "tremor left 80 %, reach bent 0.30 deg, false ACT 0.010 J, 5.0 mm -> "
    gains += "tremor left 60 %, reach bent 0.20 deg, false ACT 0.005 J, 4.0 mm"
    assert rows == [
        ("tau_on", "0.7", "0.8", "lowest; bundle's replay: precision 0.850 -> 0.920, coverage 0.300 -> 0.200"),
        ("reach: damping, mN m s/rad", "3000", "1500", gains),
        ("reach: cap, mN m", "2000", "200", "counted above"),
        ("pour: cap, mN m", "2000", "500", gains),
        ("cut", "", "as it is", gains.split(" -> ")[0]),
        ("mix", "assisted", "never", f"nothing keeps the bars; today: {gains.split(' -> ')[0]}"),
    ]


def test_ones_own_recordings_are_told_of() -> None:
    one = Threshold(0.7, 0.8, 0.9, None, None, Own(100, 80, 400), Own(10, 9, 400), "lowest")
    assert rows_of(one, profiles())[0][3] == (
        "lowest; own: precision 0.800, coverage 0.250 of 400 ticks -> precision n/a, coverage 0.025 of 400 ticks"
    )


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("", "[gate]\ntau_on = 0.8\n"),
        ("[bus]\narm = true\n", "[bus]\narm = true\n\n[gate]\ntau_on = 0.8\n"),
        ("[bus]\narm = true", "[bus]\narm = true\n\n[gate]\ntau_on = 0.8\n"),
        ("[bus]\n\n", "[bus]\n\n[gate]\ntau_on = 0.8\n"),
        ("[gate]\ntau_on = 0.7 # mine\nalpha = 0.2\n", "[gate]\ntau_on = 0.8 # mine\nalpha = 0.2\n"),
        ("[gate]\nalpha = 0.2\n\n[bus]\n", "[gate]\ntau_on = 0.8\nalpha = 0.2\n\n[bus]\n"),
        (
            "[gate] # x\nprecision = 0.8\n[bus]\ntau_on = 3\n",
            "[gate] # x\ntau_on = 0.8\nprecision = 0.8\n[bus]\ntau_on = 3\n",
        ),
        (
            "# tau_on = 0.1\n[gate]\n# tau_on = 0.2\ntau_on=0.7\n",
            "# tau_on = 0.1\n[gate]\n# tau_on = 0.2\ntau_on=0.8\n",
        ),
    ],
)
def test_a_configuration_with_another_threshold_is_else_as_it_was(text: str, wanted: str) -> None:
    made = config_with(text, 0.8)
    assert made == wanted
    assert tomllib.loads(made)["gate"]["tau_on"] == 0.8


def test_the_diff_under_its_line_to_sign_is_taken_by_patch(tmp_path: Path) -> None:
    old, new = "a = 1\nb = 2\nc = 3", "a = 1\nb = 20\nc = 30"
    motion = Motion("hand.csv", None, "hand acceleration", np.zeros(0), np.zeros((0, 3)), {"hand.csv": "ab" * 32})
    diffs = [diff_of("profiles.toml", old, new), diff_of("bridge.toml", "", "[gate]\ntau_on = 0.8\n")]
    text = to_sign("P-07", [motion], "0x1234", profiles(), diffs)
    assert "for P-07; in force for nobody until signed" in text
    assert "Checked by (clinician): ____" in text
    assert "Date: ____" in text
    assert "Profiles A6127E08 -> 0123ABCD, bundle 0x1234" in text
    assert f"hand.csv (hand acceleration), SHA-256 {'ab' * 32}" in text
    (tmp_path / "profiles.toml").write_text(old)
    (tmp_path / "bridge.toml").write_text("")
    command = ["git", "apply", "-p0", "-"]
    done = subprocess.run(command, input=text, text=True, cwd=tmp_path, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "profiles.toml").read_text() == new
    assert (tmp_path / "bridge.toml").read_text() == "[gate]\ntau_on = 0.8\n"


def test_a_wearer_without_a_name_and_nothing_to_change() -> None:
    assert diff_of("x", "a\n", "a\n") == ""
    assert "for a wearer whom no recording names;" in to_sign(None, [], "0x1", profiles(), [])
