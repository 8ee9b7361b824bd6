"""An MCAP file as it is written: chunks with their index, then a summary. The library's records, without its writer.

The library's writer takes 20 us a message, a quarter of all that recording costs; a message here is one `pack`. It also
ends a chunk when it likes; here the caller does.
"""

from __future__ import annotations

import struct
import zlib
from collections import defaultdict
from typing import IO

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Schema,
    Statistics,
    SummaryOffset,
)

MAGIC = b"\x89MCAP0\r\n"
_COMPRESSION = "zstd"
_LEVEL = 1  # the quickest: JPEG hardly shrinks, and rows are no larger than at the default level
_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_HEAD_BYTES = 22  # channel, sequence and both times, which a message's length counts
_INDEX = struct.Struct("<BQHI")
_INDEX_HEAD_BYTES = 6
_RECORD_HEAD_BYTES = 9  # opcode and length, which a record's length does not count
_CHUNK = struct.Struct("<BQQQQI")
_CHUNK_BYTES = 1 << 20  # of the memory that chunks are made in; it grows where one is larger
_NO_CRC = 0


class McapFile:
    """Appends to an open file. `end_chunk` hands over what waits; `finish` makes the file whole, and does not close it."""

    def __init__(self, file: IO[bytes], library: str) -> None:
        self._file = file
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        # One piece of memory for all chunks: to take new memory for each costs more than to fill it.
        self._memory, self._filled = bytearray(_CHUNK_BYTES), 0
        self._times_and_places: defaultdict[int, list[int]] = defaultdict(list)
        self._times_ns: list[int] = []
        self._chunks: list[ChunkIndex] = []
        self._counts: defaultdict[int, int] = defaultdict(int)
        self._compressor = zstandard.ZstdCompressor(level=_LEVEL)  # one for all: to make one costs more than to use it
        self._file.write(MAGIC + _bytes(Header("", library)))

    @property
    def chunk_bytes(self) -> int:
        """Size of the chunk under way."""
        return self._filled

    def add_channel(self, topic: str, schema_name: str, json_schema: bytes) -> int:
        """A topic of JSON messages with its schema; gives its number."""
        number = len(self._channels) + 1
        self._schemas.append(Schema(id=number, name=schema_name, encoding="jsonschema", data=json_schema))
        channel = Channel(id=number, topic=topic, message_encoding="json", metadata={}, schema_id=number)
        self._channels.append(channel)
        self._put(_bytes(self._schemas[-1]) + _bytes(channel))
        return number

    def _put(self, data: bytes) -> None:
        ends = self._filled + len(data)
        if ends > len(self._memory):
            self._memory += bytes(ends)
        self._memory[self._filled : ends] = data
        self._filled = ends

    def add_message(self, channel: int, time_ns: int, published_ns: int, sequence: int, data: bytes) -> None:
        """One message into the chunk under way. Raises struct.error for a time before 0."""
        head = _MESSAGE.pack(
            Opcode.MESSAGE, _MESSAGE_HEAD_BYTES + len(data), channel, sequence & 0xFFFFFFFF, time_ns, published_ns
        )
        self._times_and_places[channel] += (time_ns, self._filled)
        self._times_ns.append(time_ns)
        self._counts[channel] += 1
        self._put(head)
        self._put(data)

    def end_chunk(self) -> None:
        """Write the chunk under way, if it holds a message. Raises OSError; what it held is lost then."""
        if not self._times_ns:
            return
        content, times_ns = memoryview(self._memory)[: self._filled], self._times_ns
        indices = dict(self._times_and_places)
        self._filled, self._times_ns = 0, []
        self._times_and_places.clear()
        first_ns, last_ns, name = min(times_ns), max(times_ns), _COMPRESSION.encode()
        data = self._compressor.compress(content)
        size = _CHUNK.size + 4 + len(name) + 8 + len(data)
        head = _CHUNK.pack(
            Opcode.CHUNK, size - _RECORD_HEAD_BYTES, first_ns, last_ns, len(content), zlib.crc32(content)
        )
        head += struct.pack("<I", len(name)) + name + struct.pack("<Q", len(data))
        start = self._file.tell()
        offsets, index = {}, b""
        for channel, numbers in indices.items():
            offsets[channel] = start + size + len(index)
            entries = struct.pack(f"<{len(numbers)}Q", *numbers)
            index += (
                _INDEX.pack(Opcode.MESSAGE_INDEX, _INDEX_HEAD_BYTES + len(entries), channel, len(entries)) + entries
            )
        for part in (head, data, index):  # together they would be one more copy
            self._file.write(part)
        self._chunks.append(
            ChunkIndex(
                chunk_length=size,
                chunk_start_offset=start,
                compression=_COMPRESSION,
                compressed_size=len(data),
                message_end_time=last_ns,
                message_index_length=len(index),
                message_index_offsets=offsets,
                message_start_time=first_ns,
                uncompressed_size=len(content),
            )
        )

    def finish(self) -> None:
        """Write the chunk under way and the summary. Raises OSError."""
        self.end_chunk()
        self._file.write(_bytes(DataEnd(_NO_CRC)))
        start = self._file.tell()
        groups: tuple[tuple[Opcode, list[McapRecord]], ...] = (
            (Opcode.SCHEMA, [*self._schemas]),
            (Opcode.CHANNEL, [*self._channels]),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, [*self._chunks]),
        )
        summary, offsets = b"", b""
        for opcode, records in groups:
            group = b"".join(map(_bytes, records))
            if group:
                place = SummaryOffset(group_opcode=opcode, group_start=start + len(summary), group_length=len(group))
                offsets += _bytes(place)
            summary += group
        footer = Footer(summary_start=start, summary_offset_start=start + len(summary), summary_crc=_NO_CRC)
        # The checksum covers everything from the summary to the footer's own fields before it.
        checked = summary + offsets + _bytes(footer)[:-4]
        footer.summary_crc = zlib.crc32(checked)
        self._file.write(summary + offsets + _bytes(footer) + MAGIC)

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=max((chunk.message_end_time for chunk in self._chunks), default=0),
            message_start_time=min((chunk.message_start_time for chunk in self._chunks), default=0),
            metadata_count=0,
            schema_count=len(self._schemas),
        )


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    made: bytes = builder.end()  # type: ignore[no-untyped-call]  # mcap annotates most, not this
    return made
