"""observe.keeping.retention: old recordings of ours go, and nothing else does."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hilbridge.observe.keeping.retention import remove_old
from hilbridge.observe.recording import Recording
from hilbridge.rows import EventRow

DAY_S = 86_400.0
NOW_S = 1_000 * DAY_S


def recording(folder: Path, days_old: float, name: str = "recording.mcap") -> Path:
    with Recording(folder / name) as out:
        out.write(EventRow(1, "x"))
    return aged(folder / name, days_old)


def aged(path: Path, days_old: float) -> Path:
    os.utime(path, (NOW_S - days_old * DAY_S,) * 2)
    return path


@pytest.fixture
def newest(tmp_path: Path) -> Path:
    recording(tmp_path / "run-3", 40)  # the newest run, whatever its file says
    return tmp_path / "run-3"


def test_old_recordings_with_all_their_parts_go_and_young_ones_stay(tmp_path: Path, newest: Path) -> None:
    old = [recording(tmp_path / "run-1", 31), recording(tmp_path / "run-1", 31, "recording.2.mcap")]
    young = recording(tmp_path / "run-2", 29)
    removed = remove_old(newest, 30, NOW_S)
    assert sorted(removed.files) == sorted(old)
    assert removed.stay == ()
    assert not (tmp_path / "run-1").exists()
    assert young.exists()
    assert (newest / "recording.mcap").exists()


def test_what_else_is_in_a_folder_stays(tmp_path: Path, newest: Path) -> None:
    old = recording(tmp_path / "run-1", 31)
    (tmp_path / "run-1" / "notes.txt").write_text("mine")
    assert remove_old(newest, 30, NOW_S).files == (old,)
    assert [path.name for path in (tmp_path / "run-1").iterdir()] == ["notes.txt"]


def test_files_of_others_stay(tmp_path: Path, newest: Path) -> None:
    folder = tmp_path / "run-1"
    kept = [recording(folder, 99, "mine.mcap"), recording(tmp_path, 99), recording(folder / "deeper", 99)]
    (folder / "recording.mcap").write_bytes(b"\x89MCAP0\r\n\x01" + b"another program" + bytes(50))
    kept.append(aged(folder / "recording.mcap", 99))
    (folder / "recording.2.mcap").symlink_to(newest / "recording.mcap")
    assert remove_old(newest, 30, NOW_S).files == ()
    assert all(path.exists() for path in kept)


def test_a_link_to_a_folder_elsewhere_is_not_followed(tmp_path: Path, newest: Path) -> None:
    elsewhere = recording(tmp_path / "a" / "elsewhere", 99)
    (newest.parent / "linked").symlink_to(elsewhere.parent)
    assert remove_old(newest, 30, NOW_S).files == ()
    assert elsewhere.exists()
