"""observe.recording: what is written is read back, equal runs are equal bytes, a broken file is one line."""

from __future__ import annotations

import json
import os
import threading
from pathlib import Path

import jsonschema
import pytest
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap.stream_reader import StreamReader

from hilbridge.errors import InputError
from hilbridge.observe.keeping import background
from hilbridge.observe.keeping.background import BackgroundRecording
from hilbridge.observe.reading import read_recording
from hilbridge.observe.recording import Recording
from hilbridge.observe.signals import SignalRows
from hilbridge.rows import CanRow, Direction, EventRow, MetaRow, SceneRow
from hilbridge.wire.codec import Codec

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


def test_a_place_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="Is a directory"):
        Recording(tmp_path)


def test_what_never_began_leaves_no_file(tmp_path: Path) -> None:
    recording = BackgroundRecording(tmp_path / "a.mcap")
    recording.write(EventRow(1, "never began"))
    recording.discard()
    assert list(tmp_path.iterdir()) == []


def test_a_recording_is_its_owners_alone_also_in_the_place_of_another(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").touch(0o644)
    with Recording(tmp_path / "a.mcap") as recording:
        recording.write(FRAME)
    assert (tmp_path / "a.mcap").stat().st_mode & 0o777 == 0o600


def test_a_writer_that_is_killed_leaves_all_but_its_last_second(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    recording = Recording(path)
    for tick in range(250):
        recording.write(EventRow(tick * 40_000_000, str(tick)))
    reader = read_recording(path)  # as another process would, while the writer still holds what waits
    rows = list(reader)
    assert rows == [EventRow(tick * 40_000_000, str(tick)) for tick in range(len(rows))]
    assert 249 - len(rows) <= 25
    assert reader.missing is not None
    recording.close()


def test_rows_after_a_full_disk_are_counted_and_what_was_written_stays(tmp_path: Path) -> None:
    recording = BackgroundRecording(tmp_path / "a.mcap")

    def full() -> None:
        raise OSError(28, "No space left on device")

    recording._recording.current.flush = full  # type: ignore[method-assign]
    for second in range(5):
        recording.write(EventRow(second * 10**9, "row"))
    with pytest.raises(InputError, match=r"No space left.*rows were lost.*disk full"):
        recording.close()
    assert recording.lost_rows >= 3
    assert list(read_recording(recording.path)) != []


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="name a folder that can be written"):
        Recording(tmp_path / "file" / "run" / "a.mcap")


def test_publish_times_are_of_the_wall_clock_where_it_is_known(tmp_path: Path) -> None:
    with Recording(tmp_path / "a.mcap") as recording:
        recording.write(MetaRow(5, wall_minus_monotonic_ns=1_000))
        recording.write(EventRow(7, "x"))
    with (tmp_path / "a.mcap").open("rb") as file:
        stamps = [(message.log_time, message.publish_time) for _, _, message in make_reader(file).iter_messages()]
    assert stamps == [(5, 1_005), (7, 1_007)]


def test_a_strict_reader_finds_nothing_wrong(tmp_path: Path) -> None:
    with Recording(tmp_path / "a.mcap", SignalRows(Codec())) as recording:
        for number in range(300):
            recording.write(EventRow(number * 10_000_000, str(number)))
            recording.write(CanRow(number * 10_000_000, Direction.RX, 96, bytes(8), "ACT_CMD"))
    with (tmp_path / "a.mcap").open("rb") as file:
        records = list(StreamReader(file, validate_crcs=True).records)
    assert sum(isinstance(record, ChunkIndex) for record in records) >= 5
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == sum(1 for _ in reader.iter_messages()) >= 600
        for schema in summary.schemas.values():
            jsonschema.Draft202012Validator.check_schema(json.loads(schema.data))


def test_a_disk_that_fails_is_told_once_and_at_once(tmp_path: Path) -> None:
    recording, told = BackgroundRecording(tmp_path / "a.mcap"), list[str]()
    recording.on_failure = told.append

    def full() -> None:
        raise OSError(28, "No space left on device")

    recording._recording.current.flush = full  # type: ignore[method-assign]
    for second in range(5):
        recording.write(EventRow(second * 10**9, "row"))
    with pytest.raises(InputError):
        recording.close()
    assert len(told) == 1
    assert "No space left" in told[0]


def test_pictures_give_way_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(background, "_QUEUE_WITH_PICTURES", 0)
    recording = BackgroundRecording(tmp_path / "a.mcap")
    recording.write(SceneRow(1, 1, 1, 1, 1, b"rgb"))
    recording.write(EventRow(2, "x"))
    recording.close()
    assert (recording.lost_pictures, recording.lost_rows) == (1, 0)
    assert list(read_recording(recording.path)) == [EventRow(2, "x")]


def test_a_disk_that_takes_its_time_does_not_hold_up_what_is_written_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = threading.Event()
    monkeypatch.setattr(os, "fsync", lambda descriptor: free.wait(60))
    recording = Recording(tmp_path / "a.mcap", is_lasting=True)
    for tick in range(250):
        recording.write(EventRow(tick * 40_000_000, str(tick)))
    rows = list(read_recording(recording.path))  # as after a kill, while the disk is still busy with the first chunk
    assert 249 - len(rows) <= 25
    recording.close()
    free.set()


def test_a_disk_that_refuses_to_keep_is_told_with_the_next_chunk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = threading.Event()

    def refuse(descriptor: int) -> None:
        asked.set()
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", refuse)
    recording = Recording(tmp_path / "a.mcap", is_lasting=True)
    recording.write(EventRow(0, "x"))
    recording.flush()
    assert asked.wait(60)

    def until_told() -> None:
        for second in range(1, 10_000):
            recording.write(EventRow(second * 10**9, "x"))

    with pytest.raises(OSError, match="No space left"):
        until_told()
    recording.close()
