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
