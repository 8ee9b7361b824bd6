"""observe.recording: what is written is read back, equal runs are equal bytes, a broken file is one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from hilbridge.errors import InputError
from hilbridge.observe.recording import BackgroundRecording, Recording, read_recording
from hilbridge.rows import CanRow, Direction, EventRow

FRAME = CanRow(1, Direction.RX, 96, b"\x00\xff")


def test_rows_come_back_in_order_of_time(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "a.mcap"
    with Recording(path) as recording:
        recording.write(EventRow(2, "later"))
        recording.write(FRAME)
    assert list(read_recording(path)) == [FRAME, EventRow(2, "later")]
    assert list(read_recording(path, (EventRow.topic,))) == [EventRow(2, "later")]


def test_equal_rows_are_equal_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        with Recording(tmp_path / name) as recording:
            recording.write(CanRow(1, Direction.RX, 96, b"\x00\xff"))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_the_background_writer_writes_everything(tmp_path: Path) -> None:
    recording = BackgroundRecording(tmp_path / "a.mcap")
    for index in range(500):
        recording.write(EventRow(index, str(index)))
    recording.close()
    assert recording.lost_rows == 0
    assert list(read_recording(recording.path)) == [EventRow(index, str(index)) for index in range(500)]


def test_a_row_that_cannot_be_written_is_reported_at_the_end(tmp_path: Path) -> None:
    recording = BackgroundRecording(tmp_path / "a.mcap")
    recording.write(EventRow(-1, "MCAP has no time before 0"))
    with pytest.raises(InputError, match=r"a\.mcap"):
        recording.close()


def test_broken_files_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        list(read_recording(tmp_path / "none.mcap"))
    whole = tmp_path / "a.mcap"
    with Recording(whole) as recording:
        recording.write(FRAME)
    for cut in (b"", b"text", whole.read_bytes()[:-20]):
        broken = tmp_path / "broken.mcap"
        broken.write_bytes(cut)
        with pytest.raises(InputError, match=r"broken\.mcap: not a whole recording"):
            list(read_recording(broken))


def test_a_place_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="Is a directory"):
        Recording(tmp_path)


def test_an_earlier_recording_stays_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with Recording(path) as recording:
        recording.write(EventRow(1, "first"))
    first = path.read_bytes()
    again = BackgroundRecording(path)
    again.write(EventRow(1, "never began"))
    assert path.read_bytes() == first
    again.discard()
    assert path.read_bytes() == first
    assert [found.name for found in tmp_path.iterdir()] == ["a.mcap"]


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="name a folder that can be written"):
        Recording(tmp_path / "file" / "run" / "a.mcap")
