"""observe.reading: whole files, files cut off at every byte, damaged and foreign ones; never other content than written."""

from __future__ import annotations

import json
import random
import zipfile
from pathlib import Path

import pytest
import zstandard
from mcap.writer import CompressionType, Writer

from hilbridge.errors import InputError
from hilbridge.observe.reading import read_recording
from hilbridge.observe.recording import Recording
from hilbridge.observe.recover import recover
from hilbridge.rows import CanRow, Direction, EventRow, Row

ROWS: list[Row] = [
    CanRow(index * 10_000_000, Direction.RX, 160, random.Random(index).randbytes(8), "CTRL_STATUS")
    for index in range(400)
]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "a.mcap"
    with Recording(path) as recording:
        for row in ROWS:
            recording.write(row)
    return path.read_bytes()


def test_cut_off_at_every_byte_of_its_last_part_it_is_read_up_to_there(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    for end in range(len(whole) - 4000, len(whole)):
        path.write_bytes(whole[:end])
        reader = read_recording(path)
        rows = list(reader)
        assert rows == ROWS[: len(rows)]
        assert len(rows) >= 200
        assert reader.missing is not None
        assert "cut off" in reader.missing


def test_one_wrong_bit_never_gives_other_rows(whole: bytes, tmp_path: Path) -> None:
    path, chance, refused = tmp_path / "bit.mcap", random.Random(3), 0
    known = set(ROWS)
    for _ in range(400):
        damaged = bytearray(whole)
        damaged[chance.randrange(len(damaged))] ^= 1 << chance.randrange(8)
        path.write_bytes(damaged)
        reader = read_recording(path)
        try:
            rows = list(reader)
        except InputError:
            refused += 1
            continue
        assert set(rows) <= known
        assert rows == ROWS or reader.missing is not None
    assert refused


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "no MCAP file"),
        (b"text", "no MCAP file"),
        (b"\x89MCAP0\r\n", "no row before"),
        (bytes(4096), "no MCAP file"),
    ],
)
def test_what_holds_nothing_is_one_line(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / "a.mcap").write_bytes(content)
    with pytest.raises(InputError, match=rf"a\.mcap: .*{said}"):
        list(read_recording(tmp_path / "a.mcap"))


def test_a_zip_and_a_file_that_is_not_there_are_one_line(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.mcap", "w") as archive:
        archive.writestr("x", "y")
    with pytest.raises(InputError, match="no MCAP file"):
        list(read_recording(tmp_path / "a.mcap"))
    with pytest.raises(InputError, match="no such file"):
        read_recording(tmp_path / "none.mcap")


def foreign(path: Path, topic: str, value: object, compression: CompressionType = CompressionType.ZSTD) -> Path:
    with path.open("wb") as file:
        writer = Writer(file, compression=compression)
        writer.start()
        channel = writer.register_channel(topic, "json", writer.register_schema("x", "jsonschema", b"{}"))
        writer.add_message(channel, 1, json.dumps(value).encode(), 1)
        writer.finish()
    return path


@pytest.mark.parametrize(("topic", "value"), [("/tick", {"foo": 1}), ("/tick", [1, 2]), ("/pose", {}), ("/event", "x")])
def test_a_recording_of_another_program_is_one_line(tmp_path: Path, topic: str, value: object) -> None:
    with pytest.raises(InputError, match=rf"not written by hilbridge.*{topic}"):
        list(read_recording(foreign(tmp_path / "a.mcap", topic, value)))


def test_other_compression_is_read(tmp_path: Path) -> None:
    path = foreign(tmp_path / "a.mcap", "/event", {"text": "x"}, CompressionType.NONE)
    assert list(read_recording(path)) == [EventRow(1, "x")]


def test_a_small_file_that_would_fill_the_memory_is_refused_unread(tmp_path: Path) -> None:
    path = foreign(tmp_path / "a.mcap", "/event", {"text": "x" * 100_000})
    bomb = zstandard.compress(bytes(1 << 30))
    data = path.read_bytes()
    at = data.index(b"zstd") + 4
    length = int.from_bytes(data[at : at + 8], "little")
    path.write_bytes(data[:at] + len(bomb).to_bytes(8, "little") + bomb + data[at + 8 + length :])
    with pytest.raises(InputError, match="no row before"):
        list(read_recording(path))


def test_rows_of_two_threads_come_in_order_of_time(tmp_path: Path) -> None:
    times = [0, 30, 10, 20, 1_000, 990, 2_000]
    with Recording(tmp_path / "a.mcap") as recording:
        for time_ms in times:
            recording.write(EventRow(time_ms * 1_000_000, str(time_ms)))
    assert [row.time_ns // 1_000_000 for row in read_recording(tmp_path / "a.mcap")] == sorted(times)


def test_recovered_is_whole(whole: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(whole[: len(whole) * 3 // 4])
    made = recover(tmp_path / "a.mcap")
    assert made.missing is not None
    reader = read_recording(made.path)
    assert list(reader) == ROWS[: made.rows]
    assert reader.missing is None
    assert made.rows > 200


def test_nothing_is_made_of_nothing(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"text")
    with pytest.raises(InputError):
        recover(tmp_path / "a.mcap")
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]
