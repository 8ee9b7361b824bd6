"""Recordings that are played again and again: no seam, and those of one length stay in step."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from hilbridge.sensors.camera import CameraSource
from hilbridge.sensors.gaze import GazePlayer, open_gaze
from hilbridge.sensors.source import begins_again_ns

MS = 1_000_000


def dues(player: CameraSource | GazePlayer, count: int, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """When its first samples are due, where nothing takes any time."""
    found: list[int] = []

    def sleep_until(due_ns: int) -> bool:
        found.append(due_ns)
        return len(found) < count

    monkeypatch.setattr(player, "_sleep_until", sleep_until)
    monkeypatch.setattr(player, "_clock_ns", lambda: 0)
    player._read_all()
    return found


def test_a_looped_film_keeps_its_rate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for number in range(5):
        writer.write(np.full((48, 64, 3), 40 * number, np.uint8))
    writer.release()
    found = dues(CameraSource(str(path), loop=True), 23, monkeypatch)
    assert found == [40 * MS * number for number in range(23)]


def test_a_looped_gaze_keeps_its_rate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "gaze.csv"
    path.write_text("time_s,x,y\n" + "".join(f"{k / 200},0.5,0.5\n" for k in range(8)))
    found = dues(GazePlayer(open_gaze(path), loop=True), 30, monkeypatch)
    assert found == [5 * MS * number for number in range(30)]


@pytest.mark.parametrize(
    ("last_ns", "spacing_ns", "now_ns", "begins_ns"),
    [
        (100 * MS, 40 * MS, 0, 147 * MS),
        (100 * MS, 40 * MS, 200 * MS, 200 * MS),  # to open it again has taken longer
        (0, 0, 0, 8 * MS),  # a single sample does not come without end
    ],
)
def test_it_begins_again_when_its_last_sample_has_lasted(
    last_ns: int, spacing_ns: int, now_ns: int, begins_ns: int
) -> None:
    assert begins_again_ns(7 * MS, last_ns, spacing_ns, now_ns) == begins_ns
