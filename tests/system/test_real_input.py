"""`hilbridge run` on real pictures and real gaze at full speed: hands as the reference finds them, every frame accounted."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from hilbridge.records import CameraFrame
from hilbridge.sensors.hands import HandDetector
from hilbridge.sensors.models import fetch_hand_model, hand_model_path

pytestmark = pytest.mark.data


@pytest.fixture(scope="module")
def reference(data: Path) -> tuple[int, int]:
    """Pictures of the clip, and those in which the detector finds hands when it looks at every one without hurry."""
    capture = cv2.VideoCapture(str(data / "hands" / "clip_720p.mp4"))
    pictures = found = 0
    with HandDetector(fetch_hand_model(hand_model_path())) as detector:
        while True:
            ok, picture = capture.read()
            if not ok:
                return pictures, found
            rgb = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8)
            found += bool(detector.detect(CameraFrame(1 + pictures * 33_333_333, rgb, pictures)).hands)
            pictures += 1


@pytest.mark.parametrize("gaze", ["neon/demo_recording", "egtea/gaze_data/P02-R06-GreekSalad.txt"])
def test_hands_are_found_as_by_the_reference(data: Path, tmp_path: Path, reference: tuple[int, int], gaze: str) -> None:
    bus = f"hilsim:real-{os.getpid()}"
    device = subprocess.Popen([sys.executable, "-m", "firmware_sim.node", "--bus", bus], stdout=subprocess.DEVNULL)
    command = ["-m", "hilbridge.cli", "run", "--camera", str(data / "hands" / "clip_720p.mp4"), "--json"]
    command += ["--gaze", str(data / gaze), "--bus", bus, "--out", str(tmp_path / "run")]
    try:
        done = subprocess.run([sys.executable, *command], capture_output=True, text=True, timeout=120, check=False)
    finally:
        device.kill()
        device.wait()
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    camera = result["sensors"]["camera"]
    pictures, found = reference
    assert camera["received"] == pictures == camera["used"] + camera["overwritten"] + camera["failed"]
    assert result["ticks"] == pytest.approx(25 * result["seconds"], abs=3)
    assert result["frames_sent"] >= 2 * result["ticks"]
    if camera["used"] >= 0.9 * pictures:  # a machine too slow to look at most pictures says nothing about the detector
        assert camera["with_hands"] / camera["used"] >= 0.9 * found / pictures
