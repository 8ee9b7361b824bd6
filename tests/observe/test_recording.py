"""observe.recording: what is written is read back, equal runs are equal bytes, a broken file is one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from hilbridge.errors import InputError
from hilbridge.observe.recording import BackgroundRecording, Recording, read_recording


def test_rows_come_back_in_order_of_time(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "a.mcap"
    with Recording(path) as recording:
        recording.write("/tick", 2, {"b": 1, "a": [1.5, None]})
        recording.write("/can", 1, {"id": 96})
    rows = list(read_recording(path))
    assert [(row.topic, row.time_ns, row.data) for row in rows] == [
        ("/can", 1, {"id": 96}),
        ("/tick", 2, {"a": [1.5, None], "b": 1}),
    ]
    assert [row.topic for row in read_recording(path, ("/tick",))] == ["/tick"]


def test_equal_rows_are_equal_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        with Recording(tmp_path / name) as recording:
            recording.write("/tick", 5, {"x": 1, "y": 2} if name == "a" else {"y": 2, "x": 1})
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_the_background_writer_writes_everything(tmp_path: Path) -> None:
    recording = BackgroundRecording(tmp_path / "a.mcap")
    for index in range(500):
        recording.write("/tick", index, {"n": index})
    recording.close()
    assert recording.lost_rows == 0
    assert [row.data["n"] for row in read_recording(recording.path)] == list(range(500))


def test_a_row_that_cannot_be_written_is_reported_at_the_end(tmp_path: Path) -> None:
    recording = BackgroundRecording(tmp_path / "a.mcap")
    recording.write("/tick", 0, {"bad": object()})
    with pytest.raises(InputError, match=r"a\.mcap"):
        recording.close()


def test_broken_files_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        list(read_recording(tmp_path / "none.mcap"))
    whole = tmp_path / "a.mcap"
    with Recording(whole) as recording:
        recording.write("/tick", 0, {"a": 1})
    for cut in (b"", b"text", whole.read_bytes()[:-20]):
        broken = tmp_path / "broken.mcap"
        broken.write_bytes(cut)
        with pytest.raises(InputError, match=r"broken\.mcap: not a whole MCAP file"):
            list(read_recording(broken))


def test_a_place_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="Is a directory"):
        Recording(tmp_path)


def test_an_earlier_recording_stays_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with Recording(path) as recording:
        recording.write("/event", 1, {"text": "first"})
    first = path.read_bytes()
    again = BackgroundRecording(path)
    again.write("/event", 1, {"text": "never began"})
    assert path.read_bytes() == first
    again.discard()
    assert path.read_bytes() == first
    assert [found.name for found in tmp_path.iterdir()] == ["a.mcap"]


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="name a folder that can be written"):
        Recording(tmp_path / "file" / "run" / "a.mcap")
