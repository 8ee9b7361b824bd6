"""check: what a look through the senses is worth, and the look itself on a made video and gaze."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import hilbridge.sensors.camera  # noqa: F401  OpenCV asks once, at its first video, how loud FFmpeg may be
from hilbridge import cli
from hilbridge.check import Seen, judge
from hilbridge.doctor_sensors import Verdict
from hilbridge.rows import ClockRow, SourceAccount

CLOCK = ClockRow(1, "gaze neon:", 0, 0.0, 0.2, 2.0, 40, 0)


def sound() -> Seen:
    accounts = {"camera": SourceAccount(250, 250, 0, 0, 0), "gaze": SourceAccount(2000, 250, 1750, 0, 0)}
    return Seen(10.0, [20.0] * 250, [True] * 250, [8.0] * 250, [1] * 250, None, accounts, (CLOCK,))


def verdicts(seen: Seen) -> dict[str, Verdict]:
    findings = judge(seen, with_gaze=True, with_hands=True)
    assert all(finding.cure for finding in findings if finding.verdict is not Verdict.WELL)
    return {finding.subject: finding.verdict for finding in findings}


def test_all_is_well() -> None:
    assert set(verdicts(sound()).values()) == {Verdict.WELL}


@pytest.mark.parametrize(
    ("changes", "subject", "verdict"),
    [
        ({"ages_ms": []}, "camera", Verdict.ILL),
        ({"ages_ms": [20.0] * 50}, "camera", Verdict.ILL),
        ({"ages_ms": [100.0] * 250}, "camera", Verdict.NOTE),
        ({"gaze_ages_ms": []}, "gaze", Verdict.ILL),
        ({"gaze_valid": [False] * 250}, "gaze", Verdict.ILL),
        ({"clocks": (replace(CLOCK, bound_ms=12.0),)}, "clock", Verdict.ILL),
        ({"hands": [0] * 250}, "hands", Verdict.NOTE),
        ({"hands": [-1] * 250}, "hands", Verdict.ILL),
        ({"hands": []}, "hands", Verdict.ILL),
    ],
)
def test_what_is_wrong_is_said_with_its_cure(changes: dict[str, object], subject: str, verdict: Verdict) -> None:
    found = verdicts(replace(sound(), **changes))  # type: ignore[arg-type]
    assert found[subject] is verdict
    assert all(other is Verdict.WELL for name, other in found.items() if name != subject)


def test_nothing_asked_for_is_nothing_judged() -> None:
    findings = judge(replace(sound(), clocks=()), with_gaze=False, with_hands=False)
    assert [(finding.subject, finding.verdict) for finding in findings] == [
        ("camera", Verdict.WELL),
        ("gaze", Verdict.NOTE),
    ]


def test_the_command_looks_and_draws(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    video, gaze, png = tmp_path / "a.mp4", tmp_path / "a.csv", tmp_path / "a.png"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter_fourcc(*"mp4v"), 25, (128, 96))
    for index in range(100):
        writer.write(np.full((96, 128, 3), 2 * index, np.uint8))
    writer.release()
    gaze.write_text("time_s,x,y\n" + "".join(f"{index / 100:.2f},0.25,0.5\n" for index in range(400)))
    arguments = ["--camera", str(video), "--gaze", str(gaze), "--no-hands", "--seconds", "2", "--png", str(png)]
    monkeypatch.setattr(sys, "argv", ["hilbridge", "check", *arguments, "--json"])
    with pytest.raises(SystemExit):
        cli.main()
    told = json.loads(capsys.readouterr().out)
    assert [finding["subject"] for finding in told["findings"]] == ["camera", "gaze"]
    picture = cv2.imread(told["png"])
    assert picture is not None
    assert picture[48, 32, 2] > picture[48, 32, 0] + 50  # the red dot


def test_the_command_looks_through_a_folder_of_the_iassistadl_group(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("h5py")
    from tests.sensors.recorded.test_iassistadl import make

    video, folder, config = tmp_path / "a.mp4", str(make(tmp_path / "one", lose=5)), tmp_path / "a.toml"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter_fourcc(*"mp4v"), 25, (128, 96))
    for index in range(100):
        writer.write(np.full((96, 128, 3), 2 * index, np.uint8))
    writer.release()
    config.write_text("[sensors]\nskeleton_projection = [1.0, 0.0, 0.5, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 0.0, 1.0, 0.0]\n")
    arguments = ["--camera", str(video), "--gaze", folder, "--inertial", folder, "--skeleton", folder, "--no-hands"]
    arguments += ["--config", str(config), "--seconds", "2", "--png", str(tmp_path / "a.png"), "--json"]
    monkeypatch.setattr(sys, "argv", ["hilbridge", "check", *arguments])
    with pytest.raises(SystemExit):
        cli.main()
    told = {one["subject"]: one["text"] for one in json.loads(capsys.readouterr().out)["findings"]}
    assert set(told) == {"camera", "gaze", "inertial", "skeleton"}
    assert "HAND_R" in told["inertial"]
    assert "tremor" in told["inertial"]
    assert "RIGHT_WRIST" in told["skeleton"]
