"""A live run with camera that is killed, told to end, or out of disk leaves a recording that every command reads."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

from hilbridge.errors import InputError
from tests.scenarios.sessions import film
from tests.tools.crashes import await_rows, killed, left_behind, small_disk, start_run


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    film(folder)
    return folder


@pytest.mark.parametrize("after_s", [0.13, 0.71, 1.37])
def test_a_run_that_is_killed_loses_a_second_at_most(inputs: Path, tmp_path: Path, after_s: float) -> None:
    left = killed(tmp_path / "run", inputs, after_s)
    assert left.lost_s <= 1.0
    assert left.missing is not None
    assert left.pictures > 0
    assert left.ticks > 0


def test_a_run_that_is_told_to_end_leaves_a_whole_recording(inputs: Path, tmp_path: Path) -> None:
    left = killed(tmp_path / "run", inputs, 0.5, signal.SIGTERM)
    assert left.missing is None


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root may mount a small disk")
def test_a_full_disk_costs_what_no_longer_fitted(inputs: Path, tmp_path: Path) -> None:
    try:
        with small_disk(tmp_path / "small", 0.6) as out:
            run = start_run(out, inputs)
            await_rows(out, run)
            time.sleep(6.0)
            assert run.poll() is None, "a full disk must not end the bridge"
            run.send_signal(signal.SIGTERM)
            said = run.communicate(timeout=120)
            assert run.returncode == 2, said
            *notices, last = said[1].strip().splitlines()
            assert any("nothing is recorded any more" in line for line in notices)  # at once, not at the end only
            assert "is the disk full?" in last
            (tmp_path / "kept").mkdir()
            (tmp_path / "kept" / "recording.mcap").write_bytes((out / "recording.mcap").read_bytes())
    except InputError as error:
        pytest.skip(str(error))
    left = left_behind(tmp_path / "kept", 0)
    assert left.missing is not None
    assert left.ticks > 0
