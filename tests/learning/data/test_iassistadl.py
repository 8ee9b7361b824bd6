"""learning.data.iassistadl: the group's recordings are sessions, and become packs."""

from __future__ import annotations

from pathlib import Path

import pytest

from hilbridge.features.layout import GAZE
from hilbridge.features.packs import read_pack
from hilbridge.learning.data.packs import make_packs
from hilbridge.learning.data.sessions import load_features, recorded_sessions

pytest.importorskip("h5py")
from tests.sensors.recorded.test_iassistadl import make


def test_folders_of_subjects_become_packs(tmp_path: Path) -> None:
    (tmp_path / "BRAD-0701" / "1").mkdir(parents=True)
    make(tmp_path / "BRAD-0701" / "1" / "a", gaze_off_s=0.3)
    assert recorded_sessions(tmp_path) == ["BRAD-0701.1.a"]
    values, valid = load_features(tmp_path, "BRAD-0701.1.a")
    assert len(values) == 250
    assert valid[2:, 0].all()
    assert not valid[:, 1:].any()
    x = values[100, GAZE][0]
    assert x == pytest.approx(0.5 + 100 / 1088 * -0.757, abs=0.02)  # sin 4
    (made,) = make_packs(tmp_path)
    again, _ = read_pack(made)
    assert (again == values).all()
    assert recorded_sessions(tmp_path / "BRAD-0701" / "1" / "a") == ["a"]
