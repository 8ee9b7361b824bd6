"""CAN logs in all four formats: in, out, across, and files that cannot be read."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from hilbridge.bus.logs import SUFFIXES, convert, read_log, write_log
from hilbridge.errors import InputError
from hilbridge.records import Frame

START_NS = 1_700_000_000 * 10**9
FRAMES = [
    Frame(0x060, bytes(range(8)), wall_ns=START_NS),
    Frame(0x001, b"", wall_ns=START_NS + 1_000_000),
    Frame(0x0A0, b"\xff\x00", wall_ns=START_NS + 21_000_000),
    Frame(0x18DAF110, b"\x01\x02\x03", wall_ns=START_NS + 40_000_000, is_extended=True),
    Frame(0x123, bytes(64), wall_ns=START_NS + 60_000_000, is_fd=True),
]


def essence(frames: list[Frame]) -> list[tuple[int, bytes, bool, bool]]:
    return [(frame.can_id, frame.data, frame.is_extended, frame.is_fd) for frame in frames]


def stamps_us(frames: list[Frame]) -> list[int]:
    """Microseconds since the first frame: .asc begins at its own start of measurement."""
    return [round((frame.wall_ns - frames[0].wall_ns) / 1000) for frame in frames]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_is_written_is_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"trace{suffix}"
    assert write_log(path, FRAMES) == len(FRAMES)
    found = list(read_log(path))
    assert essence(found) == essence(FRAMES)
    assert stamps_us(found) == stamps_us(FRAMES)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("source", SUFFIXES)
@pytest.mark.parametrize("target", SUFFIXES)
def test_every_format_converts_into_every_other(tmp_path: Path, source: str, target: str) -> None:
    write_log(tmp_path / f"in{source}", FRAMES)
    assert convert(tmp_path / f"in{source}", tmp_path / f"out{target}") == len(FRAMES)
    found = list(read_log(tmp_path / f"out{target}"))
    assert essence(found) == essence(FRAMES)
    assert stamps_us(found) == stamps_us(FRAMES)


def test_a_candump_line_is_read_as_candump_wrote_it(tmp_path: Path) -> None:
    path = tmp_path / "candump.log"
    path.write_text("(1700000000.000100) vcan0 060#0001020304050607\n(1700000000.000200) vcan0 18DAF110#R\n")
    first, second = read_log(path)
    assert (first.can_id, first.data, first.wall_ns) == (0x060, bytes(range(8)), START_NS + 100_000)
    assert (second.can_id, second.is_extended, second.is_remote) == (0x18DAF110, True, True)


def test_files_that_cannot_be_read_say_so_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "broken.blf").write_bytes(b"LOGG" + bytes(20))
    (tmp_path / "broken.log").write_text("no candump line\n")
    for name in ("trace.txt", "missing.asc", "broken.blf", "broken.log"):
        with pytest.raises(InputError, match=name) as caught:
            list(read_log(tmp_path / name))
        assert "\n" not in str(caught.value)


def test_nothing_half_written_stays_where_writing_fails(tmp_path: Path) -> None:
    def failing() -> Iterator[Frame]:
        yield FRAMES[0]
        raise RuntimeError("the source broke")

    with pytest.raises(RuntimeError, match="the source broke"):
        write_log(tmp_path / "trace.log", failing())
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="choose a folder"):
        write_log(tmp_path / "none" / "trace.log", FRAMES)


def test_all_that_a_candump_line_says_comes_back_and_goes_out_again(tmp_path: Path) -> None:
    text = (
        "(1700000000.000000) can0 20000004#000800000000605F R\n"
        "(1700000000.000000) can1 124#R8 T\n"
        "(1700000000.100000) can1 125##2AABB T\n"
        "(1700000000.200000) vcan0 18DAF110##1 R\n"
    )
    path = tmp_path / "in.log"
    path.write_text(text)
    error, remote, fd, _ = read_log(path)
    assert (error.can_id, error.is_error, error.data.hex()) == (0x4, True, "000800000000605f")
    assert (remote.is_remote, remote.data, fd.is_fd, fd.data) == (True, b"", True, b"\xaa\xbb")
    convert(path, tmp_path / "out.log")
    assert (tmp_path / "out.log").read_text() == text


def asc(path: Path, how: str, *lines: str) -> Path:
    head = ["date Mon Mar 6 10:00:00.000 am 2023", f"base hex  timestamps {how}", "Begin TriggerBlock"]
    path.write_text("\n".join([*head, *(f"   {line}" for line in lines)]) + "\n")
    return path


def test_relative_stamps_add_up(tmp_path: Path) -> None:
    path = asc(tmp_path / "x.asc", "relative", "0.010000 1  60 Rx   d 1 01", "0.010000 1  60 Rx   d 1 02")
    assert stamps_us(list(read_log(path))) == [0, 10_000]


def test_a_file_of_which_no_line_is_understood_is_refused(tmp_path: Path) -> None:
    path = asc(tmp_path / "x.asc", "absolute", "0,010000 1  60 Rx   d 1 01")
    with pytest.raises(InputError, match="no line of it is understood"):
        list(read_log(path))
    assert list(read_log(asc(path, "absolute"))) == []  # nothing was sent: an empty log is one
