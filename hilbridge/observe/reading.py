"""Reads recordings, whole ones and what a crash left: every chunk whose checksum is right, and what is missing after it.

Rows are streamed chunk by chunk; no more of a file is in memory than a few seconds of it, whatever its size says.
"""

from __future__ import annotations

import heapq
import json
import os
import struct
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Footer, McapRecord, Message, Schema, Statistics
from mcap.stream_reader import CRCValidationError, get_chunk_data_stream

from hilbridge.errors import InputError
from hilbridge.observe.parts import recordings_in
from hilbridge.rows import MetaRow, Row, decode, is_topic

_MAGIC = b"\x89MCAP0\r\n"
# A chunk of ours holds a second or a mebibyte; others write 4 MiB or so.
_MOST_CHUNK_BYTES = 64 << 20
# Rows of two threads may come in a little out of order of time.
_REORDER_NS = 2_000_000_000
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_LAST_OPCODE = 0x0F
_READ: dict[int, Any] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.MESSAGE: Message,
    Opcode.CHUNK: Chunk,
    Opcode.STATISTICS: Statistics,
    Opcode.DATA_END: DataEnd,
    Opcode.FOOTER: Footer,
}
_DAMAGE = (McapError, CRCValidationError, zstandard.ZstdError, struct.error, ValueError, EOFError, OverflowError)


class RecordingReader:
    """The rows of a recording in order of time, over all its parts; `missing` says after iteration what it lacks, None for
    a whole one. `schemas` has those of the topics met so far.

    Iteration raises InputError where a file is no recording of ours at all, or not of the same run as the first.
    """

    def __init__(self, paths: Sequence[Path], topics: Collection[str] | None = None) -> None:
        """Raises InputError where there is no such file. `topics`: only rows of these; one that ends in / is a family."""
        for path in paths:
            if not path.is_file():
                raise InputError(
                    f"recording {path}: no such file; `hilbridge demo --out DIR` writes DIR/recording.mcap"
                )
        self.path = paths[0]
        self.missing: str | None = None
        self.schemas: dict[str, dict[str, Any]] = {}
        self._paths = paths
        self._topics = None if topics is None else frozenset(topics)
        self._families = tuple(topic for topic in topics or () if topic.endswith("/"))
        self._rows = 0
        self._run: MetaRow | None = None

    def __iter__(self) -> Iterator[Row]:
        """Stream the rows. Raises InputError."""
        self.missing, self._run = None, None
        yield from _in_order(row for path in self._paths for row in self._of_file(path))

    def _of_file(self, path: Path) -> Iterator[Row]:
        self._rows = 0
        missing, self.missing = self.missing, None
        try:
            with path.open("rb") as file:
                if file.read(len(_MAGIC)) != _MAGIC:
                    raise InputError(f"recording {path}: no MCAP file; name a recording that hilbridge wrote")
                yield from self._messages(path, file)
        except OSError as error:
            raise InputError(f"recording {path}: {error.strerror}") from None
        if self._rows == 0 and self.missing is not None:
            raise InputError(f"recording {path}: {self.missing}, and no row before that")
        self.missing = missing or self.missing

    def _messages(self, path: Path, file: IO[bytes]) -> Iterator[Row]:
        channels: dict[int, Channel] = {}
        schemas: dict[int, Schema] = {}
        ended, counted = False, None
        try:
            # Only chunks are checked here, by their own checksums: their rows must not wait for the end of the file.
            for record in _records(file):
                ended |= isinstance(record, DataEnd | Footer)
                if isinstance(record, Statistics):
                    counted = record.message_count
                for part in _parts(record, self._is_asked_for(channels)):
                    if isinstance(part, Message):
                        row = self._row(path, part, channels)
                        if row is not None:
                            yield row
                    elif isinstance(part, Channel):
                        if not is_topic(part.topic):
                            why = f"{part.topic}: no such topic"
                            raise InputError(f"recording {path}: not written by hilbridge as it is now ({why})")
                        channels[part.id] = part
                        self._note_schema(part.topic, schemas.get(part.schema_id))
                    elif isinstance(part, Schema):
                        schemas[part.id] = part
        except InputError:
            raise
        except _DAMAGE as error:
            self.missing = self._told(str(error).splitlines()[0] if str(error) else "the file ends in the middle")
        else:
            if not ended:
                self.missing = self._told("it has no end")
            elif counted != self._rows:
                self.missing = self._told(f"{counted} rows were written")

    def _note_schema(self, topic: str, schema: Schema | None) -> None:
        if schema is not None and topic not in self.schemas:
            read = json.loads(schema.data)
            if isinstance(read, dict):
                self.schemas[topic] = read

    def _wants(self, topic: str) -> bool:
        return self._topics is None or topic in self._topics or topic.startswith(self._families or ("\0",))

    def _is_asked_for(self, channels: dict[int, Channel]) -> Callable[[int], bool]:
        """Counts a message of a channel, and says whether anybody wants it. Raises ValueError for an unknown channel."""
        wanted: dict[int, bool] = {}

        def asked(channel_id: int) -> bool:
            known = wanted.get(channel_id)
            if known is None:
                if channel_id not in channels:
                    raise ValueError(f"a message of the unknown channel {channel_id}")
                topic = channels[channel_id].topic
                known = wanted[channel_id] = self._wants(topic) or topic == MetaRow.topic
            self._rows += 1
            return known

        return asked

    def _row(self, path: Path, message: Message, channels: dict[int, Channel]) -> Row | None:
        topic = channels[message.channel_id].topic
        try:
            row = decode(topic, message.log_time, message.data)
        except ValueError as error:
            raise InputError(f"recording {path}: not written by hilbridge as it is now ({error})") from None
        if isinstance(row, MetaRow):
            self._same_run(path, row)
        return row if self._wants(topic) else None

    def _same_run(self, path: Path, meta: MetaRow) -> None:
        """Parts of two runs are no recording."""
        run = replace(meta, time_ns=0, part=1)
        if self._run is None:
            self._run = run
        elif path != self.path and run != self._run:
            raise InputError(f"recording {path}: of another run than {self.path}; name the parts of one")

    def _told(self, why: str) -> str:
        return f"cut off or damaged after {self._rows} rows ({why}); `hilbridge recover` makes a whole file of what is left"


def _records(file: IO[bytes]) -> Iterator[McapRecord]:
    """The file's own records in their order, indices left out; no more is read than there is, whatever a length says.

    Raises what `_DAMAGE` names where the file is damaged or ends before its end.
    """
    size, at = os.fstat(file.fileno()).st_size, len(_MAGIC)
    file.seek(at)
    while True:
        head = file.read(_HEAD.size)
        if head == _MAGIC:
            return
        if len(head) < _HEAD.size:
            raise EOFError("the file ends in the middle")
        opcode, length = _HEAD.unpack(head)
        at += _HEAD.size + length
        if at > size:
            raise EOFError("the file ends in the middle")
        if not 0 < opcode <= _LAST_OPCODE:
            raise ValueError(f"a record of the unknown kind {opcode:#04x}")
        if opcode not in _READ:
            file.seek(at)
        elif length > _MOST_CHUNK_BYTES:
            raise ValueError(f"a record of {length} bytes")
        else:
            stream = ReadDataStream(BytesIO(file.read(length)))
            yield Message.read(stream, length) if opcode == Opcode.MESSAGE else _READ[opcode].read(stream)


def _parts(record: McapRecord, is_asked_for: Callable[[int], bool]) -> Iterator[McapRecord]:
    """What a record holds, a chunk's content with its checksum right, less messages that nobody wants.

    Raises ValueError for a chunk that would not fit.
    """
    if not isinstance(record, Chunk):
        if not isinstance(record, Message) or is_asked_for(record.channel_id):
            yield record
        return
    if record.uncompressed_size > _MOST_CHUNK_BYTES:
        raise ValueError(f"a chunk of {record.uncompressed_size} bytes")
    if record.compression == "zstd" and zstandard.frame_content_size(record.data) != record.uncompressed_size:
        raise ValueError("a chunk whose size is not what it says")
    if record.uncompressed_crc == 0:
        raise ValueError("a chunk without a checksum")
    stream, size = get_chunk_data_stream(record, validate_crc=True)
    # Most of a recording is pictures and frames that few ask for: they are stepped over, not taken apart.
    yield from _content(stream.read(size), is_asked_for)


def _content(data: bytes, is_asked_for: Callable[[int], bool]) -> Iterator[McapRecord]:
    at = 0
    while at < len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        end = at + length
        if end > len(data):
            raise ValueError("a record beyond the end of its chunk")
        if opcode == Opcode.MESSAGE:
            channel_id, sequence, log_time, publish_time = _MESSAGE.unpack_from(data, at)
            if is_asked_for(channel_id):
                yield Message(channel_id, log_time, data[at + _MESSAGE.size : end], publish_time, sequence)
        elif opcode == Opcode.CHANNEL:
            yield Channel.read(ReadDataStream(BytesIO(data[at:end])))
        elif opcode == Opcode.SCHEMA:
            yield Schema.read(ReadDataStream(BytesIO(data[at:end])))
        at = end


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


def read_recording(places: Path | Sequence[Path], topics: Collection[str] | None = None) -> RecordingReader:
    """The rows of a recording in order of time, read up to where it is whole; `missing` says what lacks after that.

    `places`: a file, a run's folder, or the parts in their order.
    """
    return RecordingReader(recordings_in([places] if isinstance(places, Path) else places), topics)
