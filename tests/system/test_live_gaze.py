"""A run of the bridge with a Neon that is played: what happens to it is in the recording, and each time the bridge recovers."""

from __future__ import annotations

import math
import socket
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

import hilbridge.sensors.camera  # noqa: F401  OpenCV asks once, at its first video, how loud FFmpeg may be
from hilbridge.observe.reading import read_recording
from hilbridge.rows import ClockRow, EventRow, InertialRow, TickRow

pytest.importorskip("pupil_labs.realtime_api")

from tests.sensors.live.fake_neon import FakeNeon
from tests.sensors.live.test_udp import Sender


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


class Shaking(Sender):
    """A hand that shakes at 12 Hz, with a clock of its own; stamped when it is felt, as a sensor does."""

    def _run(self) -> None:
        while not self._closing.is_set():
            at_ns = self.now_ns()
            felt = {"sensor": "HAND_R", "x": 3.0 * math.sin(2 * math.pi * 12.0 * at_ns * 1e-9), "y": 0.0, "z": 9.81}
            try:
                if self.sending:
                    self.send({**felt, "t_ns": at_ns})
                probe = self.socket.recv(1000)
                self.send(probe.rstrip().removesuffix(b"}") + b', "t_ns": %d}' % self.now_ns())
            except OSError:
                continue


def test_a_tremor_of_12_hz_is_felt_live_and_sensors_that_fall_silent_hold(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [str(Path(sys.executable).with_name("hilbridge")), "run", "--loop", "--no-hands", "--no-video"]
    command += ["--camera", str(video(tmp_path / "scene.mp4")), "--inertial", f"udp:{port}", "--out", str(out)]
    with subprocess.Popen(
        [*command, "--bus", f"hilsim:{tmp_path.name}", "--seconds", "40"],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
    ) as run:
        assert run.stderr is not None

        def until(said: str) -> None:
            assert run.stderr is not None
            while line := run.stderr.readline().decode():
                if said in line:
                    return
            raise AssertionError(f"it never said {said!r}")

        sender = None
        while sender is None:
            try:
                sender = Shaking(port, skew_ns=10**17)
            except OSError:
                time.sleep(0.1)
        try:
            until("inertial comes")
            time.sleep(3.0)
            sender.close()
            until("nothing comes")
        finally:
            run.terminate()
            run.communicate()
    ticks = [row for row in read_recording(out) if isinstance(row, TickRow)]
    felt = [row for row in ticks if row.felt_tremor]
    assert felt
    assert felt[-1].felt_hz is not None
    assert abs(felt[-1].felt_hz - 12.0) < 0.3
    assert any(row.sensor_problem in ("inertial silent for more than 80 ms", "inertial is gone") for row in ticks[-30:])
    assert sum(isinstance(row, InertialRow) for row in read_recording(out)) > 100
