"""The whole way: recordings of people -> training -> certificate -> one wearer -> `run --arm` against a device."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch")

from hilbridge.observe.reading import read_recording
from hilbridge.rows import BundleRow
from tests.people.before_a_camera import bundle_of_one_wearer, filmed

RUN_S = 400
FILM_S = 16.0


def armed_run(root: Path, bundle: Path, bus: str) -> tuple[dict[str, Any], BundleRow]:
    """What `run --arm` with a bundle of people came to, and what its recording says of the bundle."""
    video, gaze = filmed(root, 42_020, FILM_S)
    command = [sys.executable, "-m", "firmware_sim.node", "--bus", bus]
    device = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert device.stdout is not None
        assert "ready" in device.stdout.readline()
        asked = ["run", "--camera", str(video), "--gaze", str(gaze), "--no-hands", "--bus", bus, "--arm", "--json"]
        asked += ["--bundle", str(bundle), "--out", str(root / "run")]
        ran = [sys.executable, "-m", "hilbridge.cli", *asked]
        done = subprocess.run(ran, capture_output=True, text=True, timeout=RUN_S, check=False)
    finally:
        device.kill()
        device.communicate()
    assert done.returncode == 0, done.stderr
    rows = [row for row in read_recording(root / "run", (BundleRow.topic,)) if isinstance(row, BundleRow)]
    return json.loads(done.stdout), rows[0]


def assert_of_people(result: dict[str, Any], bundle: BundleRow) -> None:
    """It may act, armed the device, and its recording says on whose data it stands."""
    assert bundle.doubt is None
    assert bundle.provenance is not None
    assert (bundle.provenance["origin"], bundle.provenance["people"]) == ("recorded people", 12)
    assert bundle.provenance["certificate"]["origin"] == "recorded people"
    assert bundle.provenance["figures"]["adapted_to_one_wearer"]["files"] == 1
    assert result["device_states"].get("Ready", 0) + result["device_states"].get("Assist", 0) > 0


@pytest.mark.timeout(900)
def test_a_bundle_of_people_arms_a_device(tmp_path: Path) -> None:
    _, _, bundle = bundle_of_one_wearer(tmp_path)
    result, row = armed_run(tmp_path, bundle, f"hilsim:people-{os.getpid()}")
    assert_of_people(result, row)
    assert result["acts"] >= 1, result["hold_reasons"]
