"""The device's part of tuning as a program: lines of JSON in and out, one line for what cannot be used."""

from __future__ import annotations

import io
import json
from math import pi, sin
from pathlib import Path
from typing import Any

import pytest

from firmware_sim.assist_profile import Profile
from firmware_sim.profile_file import SHIPPED, read
from firmware_sim.tuning import process
from firmware_sim.tuning.trial import Figures, FollowLatched, Trials

SECONDS = [ms * 0.01 for ms in range(600)]
HAND = {"t_s": SECONDS, "acceleration": [[2.0 * sin(2 * pi * 5.0 * t_s), 0.0, 9.81] for t_s in SECONDS]}


def asked(**more: Any) -> dict[str, Any]:
    return {"profiles": None, "control": "steady", "cuff_nm_rad": None, "recordings": [HAND], **more}


def run(request: dict[str, Any]) -> tuple[int, list[dict[str, Any]]]:
    out = io.StringIO()
    code = process.main(io.StringIO(json.dumps(request)), out)
    return code, [json.loads(line) for line in out.getvalue().splitlines()]


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> list[Profile]:
    """No trials: less damping is better, a cap does not matter. Keeps what was asked."""
    tried: list[Profile] = []

    def figures(self: Trials, profile: Profile) -> Figures:
        assert len(self.wearer.tremors_nm[0]) == 4_000
        tried.append(profile)
        return Figures(0.5 + profile.damping * 1e-4, 0.3, 0.01, 5.0)

    monkeypatch.setattr(Trials, "figures", figures)
    return tried


def test_what_is_proposed_and_how_far_it_is(quick: list[Profile]) -> None:
    code, said = run(asked())
    assert code == 0
    assert said[0] == {"of": 56}
    assert [list(one) for one in said[1:-1]] == [["tried"]] * 56
    found = said[-1]["result"]
    assert found["old_text"] == SHIPPED.read_text(encoding="utf-8")
    assert found["old_hash"] == f"{read().hash32:08X}" != found["new_hash"]
    assert [one["profile"] for one in found["profiles"]] == [
        "reach",
        "open",
        "pour",
        "cut",
        "mix",
        "inspect",
        "operate",
    ]
    reach = found["profiles"][0]
    assert reach["verbs"] == ["Take", "Put", "Transfer"]
    assert (reach["old"]["damping_mnms_rad"], reach["new"]["damping_mnms_rad"], reach["new"]["cap_mnm"]) == (
        3000,
        0,
        200,
    )
    assert reach["old_figures"]["left"] == pytest.approx(0.8)
    assert reach["new_figures"] == {
        "left": 0.5, "distorted_deg": 0.3, "work_j": 0.01, "hand_mm": 5.0, "latched": False, "holds": True
    }  # fmt: skip


def test_a_file_of_ones_own_is_where_it_starts_from(quick: list[Profile], tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text(SHIPPED.read_text(encoding="utf-8").replace("cap_mnm = 2000", "cap_mnm = 400"), encoding="utf-8")
    code, said = run(asked(profiles=str(own)))
    assert code == 0
    assert said[-1]["result"]["profiles"][0]["new"]["cap_mnm"] == 40
    assert max(one.cap_unm for one in quick) == 1_500_000
    own.write_text(SHIPPED.read_text(encoding="utf-8").replace("cap_mnm = 1000", "cap_mnm = 1001"), encoding="utf-8")
    code, said = run(asked(profiles=str(own)))
    assert code == 2
    assert [list(one) for one in said] == [["error"]]
    assert "cap_mnm" in said[0]["error"]


def test_what_latches_and_what_is_interrupted(monkeypatch: pytest.MonkeyPatch) -> None:
    def latches(self: Trials, profile: Profile) -> Figures:
        raise FollowLatched("it latches")

    def stops(self: Trials, profile: Profile) -> Figures:
        raise KeyboardInterrupt

    monkeypatch.setattr(Trials, "figures", latches)
    assert run(asked()) == (2, [{"of": 56}, {"error": "it latches"}])
    monkeypatch.setattr(Trials, "figures", stops)
    assert run(asked()) == (130, [{"of": 56}])
