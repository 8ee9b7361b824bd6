"""observe.parts: a long recording in parts, each whole, and all of them read as one."""

from __future__ import annotations

from pathlib import Path

import pytest

from hilbridge.errors import InputError
from hilbridge.observe.keeping.background import BackgroundRecording
from hilbridge.observe.parts import RecordingInParts, Rotation, part_number, part_path, recordings_in
from hilbridge.observe.reading import read_recording
from hilbridge.observe.recording import AddsNothing, Recording
from hilbridge.rows import EventRow, MetaRow, Row

S = 1_000_000_000


def record(path: Path, seconds: int, rotation: Rotation, title: str = "a") -> list[Row]:
    rows: list[Row] = [
        MetaRow(0, title=title),
        *(EventRow(second * S // 4, str(second)) for second in range(4 * seconds)),
    ]
    recording = RecordingInParts(path, AddsNothing(), rotation)
    for row in rows:
        recording.write(row)
    recording.close()
    return rows


def test_each_part_is_a_whole_recording_and_all_of_them_are_one(tmp_path: Path) -> None:
    rows = record(tmp_path / "recording.mcap", 10, Rotation(after_ns=3 * S))
    files = recordings_in([tmp_path])
    assert [path.name for path in files] == [
        "recording.mcap",
        "recording.2.mcap",
        "recording.3.mcap",
        "recording.4.mcap",
    ]
    for number, path in enumerate(files, 1):
        reader = read_recording(path)
        first, *rest = list(reader)
        assert isinstance(first, MetaRow)
        assert (first.part, first.title) == (number, "a")
        assert rest
        assert reader.missing is None
    together = read_recording(tmp_path)
    assert [row for row in together if isinstance(row, EventRow)] == rows[1:]
    assert together.missing is None


def test_parts_end_by_size(tmp_path: Path) -> None:
    record(tmp_path / "recording.mcap", 60, Rotation(after_bytes=2_000))
    files = recordings_in([tmp_path])
    assert len(files) > 2
    assert all(path.stat().st_size < 20_000 for path in files)


def test_ten_parts_are_in_order(tmp_path: Path) -> None:
    record(tmp_path / "recording.mcap", 12, Rotation(after_ns=S))
    assert [part_number(path) for path in recordings_in([tmp_path])] == list(range(1, 13))
    texts = [int(row.text) for row in read_recording(tmp_path) if isinstance(row, EventRow)]
    assert texts == sorted(texts)


def test_a_new_recording_leaves_no_part_of_the_one_before(tmp_path: Path) -> None:
    record(tmp_path / "recording.mcap", 10, Rotation(after_ns=3 * S))
    record(tmp_path / "recording.mcap", 2, Rotation())
    assert [path.name for path in recordings_in([tmp_path])] == ["recording.mcap"]


def test_a_part_that_is_cut_off_is_told_and_the_next_is_read(tmp_path: Path) -> None:
    rows = record(tmp_path / "recording.mcap", 10, Rotation(after_ns=3 * S))
    second = tmp_path / "recording.2.mcap"
    second.write_bytes(second.read_bytes()[:-900])
    reader = read_recording(tmp_path)
    events = [row for row in reader if isinstance(row, EventRow)]
    assert reader.missing is not None
    assert events[-1] == rows[-1]


def test_parts_of_two_runs_are_no_recording(tmp_path: Path) -> None:
    record(tmp_path / "a.mcap", 1, Rotation(), "a")
    record(tmp_path / "b.mcap", 1, Rotation(), "b")
    with pytest.raises(InputError, match=r"b\.mcap: of another run than .*a\.mcap"):
        list(read_recording([tmp_path / "a.mcap", tmp_path / "b.mcap"]))


def test_a_folder_without_a_recording_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a folder without recording\.mcap"):
        read_recording(tmp_path)


def test_a_recording_that_never_began_leaves_no_part(tmp_path: Path) -> None:
    recording = BackgroundRecording(tmp_path / "recording.mcap", None, Rotation(after_ns=S))
    for second in range(5):
        recording.write(EventRow(second * S, "x"))
    recording.discard()
    assert list(tmp_path.iterdir()) == []


def test_rows_after_the_next_part_could_not_begin_are_counted(tmp_path: Path) -> None:
    (tmp_path / "recording.2.mcap").mkdir()
    with pytest.raises((OSError, InputError)):
        record(tmp_path / "recording.mcap", 3, Rotation(after_ns=S))


def test_names_of_parts() -> None:
    assert part_path(Path("run/recording.mcap"), 1) == Path("run/recording.mcap")
    assert part_path(Path("run/recording.mcap"), 12) == Path("run/recording.12.mcap")
    assert part_number(Path("run/recording.12.mcap")) == 12


def test_what_was_added_to_a_recording_is_recovered_with_its_schema(tmp_path: Path) -> None:
    from hilbridge.observe.recover import recover
    from hilbridge.observe.signals import SignalRows
    from hilbridge.rows import CanRow, Direction, SignalRow
    from hilbridge.wire.codec import Codec

    codec = Codec()
    data = codec.encode("ACT_CMD", {"Gate": "Hold", "Verb": "None"})
    with Recording(tmp_path / "a.mcap", SignalRows(codec)) as recording:
        recording.write(CanRow(5, Direction.TX, codec.messages["ACT_CMD"].can_id, data, None, "sent"))
    made = recover(tmp_path / "a.mcap")
    first, again = read_recording(tmp_path / "a.mcap"), read_recording(made.path)
    assert list(first) == list(again)
    assert first.schemas == again.schemas
    assert any(isinstance(row, SignalRow) and row.values["Gate_text"] == "Hold" for row in again)
