"""Reads recordings, whole ones and what a crash left: every chunk whose checksum is right, and what is missing after it.

Rows are streamed chunk by chunk; no more of a file is in memory than a few seconds of it, whatever its size says.
"""

from __future__ import annotations

import heapq
import os
import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import IO, cast

import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, DataEnd, Footer, McapRecord, Message, Statistics
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk

from hilbridge.errors import InputError
from hilbridge.rows import Row, decode

_MAGIC = b"\x89MCAP0\r\n"
# A chunk of ours holds a second or a mebibyte; others write 4 MiB or so.
_MOST_CHUNK_BYTES = 64 << 20
# Rows of two threads may come in a little out of order of time.
_REORDER_NS = 2_000_000_000
_DAMAGE = (McapError, CRCValidationError, zstandard.ZstdError, struct.error, ValueError, EOFError, OverflowError)


class _Clamped:
    """A file that is never asked for more than it has: a damaged length must not take memory."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._left = os.fstat(file.fileno()).st_size

    def read(self, size: int = -1) -> bytes:
        data = self._file.read(min(size, self._left) if size >= 0 else self._left)
        self._left -= len(data)
        return data


class RecordingReader:
    """The rows of one file in order of time; `missing` says after iteration what the file lacks, None for a whole one.

    Iteration raises InputError where the file is no recording of ours at all.
    """

    def __init__(self, path: Path, topics: Collection[str] | None = None) -> None:
        """Raises InputError where there is no such file. `topics`: only rows of these."""
        if not path.is_file():
            raise InputError(f"recording {path}: no such file; `hilbridge demo --out DIR` writes DIR/recording.mcap")
        self.path = path
        self.missing: str | None = None
        self._topics = topics
        self._last_ns = 0
        self._rows = 0

    def __iter__(self) -> Iterator[Row]:
        """Stream the rows. Raises InputError."""
        self.missing, self._rows = None, 0
        try:
            with self.path.open("rb") as file:
                if file.read(len(_MAGIC)) != _MAGIC:
                    raise InputError(f"recording {self.path}: no MCAP file; name a recording that hilbridge wrote")
                file.seek(0)
                yield from _in_order(self._messages(file))
        except OSError as error:
            raise InputError(f"recording {self.path}: {error.strerror}") from None
        if self._rows == 0 and self.missing is not None:
            raise InputError(f"recording {self.path}: {self.missing}, and no row before that")

    def _messages(self, file: IO[bytes]) -> Iterator[Row]:
        channels: dict[int, Channel] = {}
        ended, counted = False, None
        try:
            # Only chunks are checked here, by their own checksums: their rows must not wait for the end of the file.
            for record in StreamReader(
                cast(IO[bytes], _Clamped(file)), emit_chunks=True, record_size_limit=_MOST_CHUNK_BYTES
            ).records:
                ended |= isinstance(record, DataEnd | Footer)
                if isinstance(record, Statistics):
                    counted = record.message_count
                for part in _parts(record):
                    if isinstance(part, Channel):
                        channels[part.id] = part
                    elif isinstance(part, Message):
                        row = self._row(part, channels)
                        if row is not None:
                            yield row
        except InputError:
            raise
        except _DAMAGE as error:
            self.missing = self._told(str(error).splitlines()[0] if str(error) else "the file ends in the middle")
        else:
            if not ended:
                self.missing = self._told("it has no end")
            elif counted != self._rows:
                self.missing = self._told(f"{counted} rows were written")

    def _row(self, message: Message, channels: dict[int, Channel]) -> Row | None:
        channel = channels.get(message.channel_id)
        if channel is None:
            raise ValueError(f"a message of the unknown channel {message.channel_id}")
        self._last_ns, self._rows = max(self._last_ns, message.log_time), self._rows + 1
        if self._topics is not None and channel.topic not in self._topics:
            return None
        try:
            return decode(channel.topic, message.log_time, message.data)
        except ValueError as error:
            raise InputError(f"recording {self.path}: not written by hilbridge as it is now ({error})") from None

    def _told(self, why: str) -> str:
        return f"cut off or damaged after {self._rows} rows ({why}); `hilbridge recover` makes a whole file of what is left"


def _parts(record: McapRecord) -> list[McapRecord]:
    """What a record holds, a chunk's content with its checksum right. Raises ValueError for one that would not fit."""
    if not isinstance(record, Chunk):
        return [record]
    if record.uncompressed_size > _MOST_CHUNK_BYTES:
        raise ValueError(f"a chunk of {record.uncompressed_size} bytes")
    if record.compression == "zstd" and zstandard.frame_content_size(record.data) != record.uncompressed_size:
        raise ValueError("a chunk whose size is not what it says")
    if record.uncompressed_crc == 0:
        raise ValueError("a chunk without a checksum")
    return breakup_chunk(record, validate_crc=True)


def _in_order(rows: Iterator[Row]) -> Iterator[Row]:
    """By time, in the order written where times are equal."""
    waiting: list[tuple[int, int, Row]] = []
    newest_ns = 0
    for number, row in enumerate(rows):
        heapq.heappush(waiting, (row.time_ns, number, row))
        newest_ns = max(newest_ns, row.time_ns)
        while waiting[0][0] < newest_ns - _REORDER_NS:
            yield heapq.heappop(waiting)[2]
    while waiting:
        yield heapq.heappop(waiting)[2]


def read_recording(path: Path, topics: Collection[str] | None = None) -> RecordingReader:
    """The rows of a recording in order of time, read up to where it is whole; `missing` says what lacks after that."""
    return RecordingReader(path, topics)
