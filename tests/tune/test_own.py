"""tau_on by the wearer's own labelled recordings: the gate replayed on them, at each threshold asked for."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("torch")

from hilbridge.intent.bundle import demo_bundle_path, load_bundle
from hilbridge.people.simulate import difficulty_named, simulate
from hilbridge.tune import run
from tests.tune.test_motion import felt, recording

BUNDLE = load_bundle(demo_bundle_path())


def test_labelled_recordings_say_how_often_the_gate_is_right(tmp_path: Path) -> None:
    made = simulate(tmp_path, 1, 30.0, difficulty_named("demo"), 30_000, lambda: None)
    said: list[str] = []
    own_at = run._own(BUNDLE, [made[0].parent], said.append)
    assert own_at is not None
    low, high = own_at(0.4), own_at(0.95)
    assert low.known == high.known > 500
    assert low.acts >= high.acts
    assert 0 <= low.right <= low.acts
    assert low.acts > 0
    assert said == []


def test_what_nobody_labelled_and_what_has_no_features_is_told(tmp_path: Path) -> None:
    said: list[str] = []
    bare = recording(tmp_path / "a.mcap", *felt("HAND_R", 5))
    assert run._own(BUNDLE, [bare, tmp_path / "hand.csv"], said.append) is None
    assert "has no /features" in said[0]
    assert "no recording is labelled" in said[1]
    assert run._own(BUNDLE, [tmp_path / "hand.csv"], said.append) is None
    assert len(said) == 2
