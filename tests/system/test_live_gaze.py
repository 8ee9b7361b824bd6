"""A run of the bridge with a Neon that is played: what happens to it is in the recording, and each time the bridge recovers."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

import hilbridge.sensors.camera  # noqa: F401  OpenCV asks once, at its first video, how loud FFmpeg may be
from hilbridge.observe.reading import read_recording
from hilbridge.rows import ClockRow, EventRow, TickRow

pytest.importorskip("pupil_labs.realtime_api")

from tests.sensors.live.fake_neon import FakeNeon


def video(path: Path) -> Path:
    """Two seconds of pictures that all differ."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 25, (128, 96))
    for index in range(50):
        writer.write(np.full((96, 128, 3), 5 * index, np.uint8))
    writer.release()
    return path


def test_what_happens_to_a_live_eye_tracker_is_held_recorded_and_got_over(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with FakeNeon() as phone:
        command = [str(Path(sys.executable).with_name("hilbridge"))]
        command += ["run", "--camera", str(video(tmp_path / "scene.mp4")), "--loop", "--no-hands", "--no-video"]
        (tmp_path / "bridge.toml").write_text("[sensors]\ngaze_same_camera = true\n")
        command += [
            "--config",
            str(tmp_path / "bridge.toml"),
            "--gaze",
            f"neon:127.0.0.1:{phone.port}",
            "--bus",
            f"hilsim:{tmp_path.name}",
            "--out",
            str(out),
        ]
        with subprocess.Popen([*command, "--seconds", "60"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as run:
            assert run.stdout is not None
            lines: list[str] = []

            def until(said: str) -> None:
                """Read what it prints until this comes."""
                assert run.stdout is not None
                while not lines or said not in lines[-1]:
                    line = run.stdout.readline()
                    assert line, lines
                    lines.append(line.decode())

            def came() -> None:
                until("gaze comes")

            came()
            for happens, said in (
                (lambda: setattr(phone, "silent", True), "no gaze for 1 s"),
                (lambda: setattr(phone, "worn", False), "not worn"),
                (lambda: setattr(phone, "skew_ns", phone.skew_ns + 300_000_000), "clock was set by"),
            ):
                happens()
                until(said)
                phone.silent, phone.worn = False, True
                came()
            time.sleep(1.5)  # so that what is written once a second is there
            run.terminate()
            run.communicate(timeout=60)
    rows = list(read_recording(out))
    texts = [row.text for row in rows if isinstance(row, EventRow)]
    for said in ("no gaze for 1 s", "not worn", "clock was set by +", "gaze comes"):
        assert any(said in text for text in texts), said
    problems = [row.sensor_problem for row in rows if isinstance(row, TickRow)]
    assert {"gaze silent for more than 80 ms", "gaze is gone"} <= set(problems)
    assert problems[-1] is None
    clocks = [row for row in rows if isinstance(row, ClockRow)]
    assert clocks[-1].steps == 1
    assert clocks[-1].bound_ms < 10
