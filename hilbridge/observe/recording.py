"""Writes recordings: MCAP with JSON messages, so that Foxglove, `mcap` and ten lines of Python can read them.

A recording survives its writer: it is written in place, in chunks of a second at most, each handed to the system at
once. Whatever ends the process, what stands in the file up to the last chunk can be read (`observe.reading`).

Log times are the monotonic stamps of what happened, publish times the wall clock where the run's MetaRow knows it. In
virtual time they are the same, so the same run gives the same bytes.
"""

from __future__ import annotations

import errno
import json
import os
import queue
import struct
import threading
from pathlib import Path
from types import TracebackType

from mcap.writer import CompressionType, Writer

from hilbridge.errors import InputError
from hilbridge.priority import Level, take_level
from hilbridge.rows import MetaRow, Row, encode, json_schema

# A minute of everything the bridge says. A disk that is slower than that loses rows, which are counted and shown.
_QUEUE_ROWS = 20_000
_CHUNK_NS = 1_000_000_000
_CHUNK_BYTES = 1 << 20
_ONLY_ITS_OWNER = 0o600  # a recording is of a person


class _ChunkWriter(Writer):
    """The library ends a chunk by its size only; a crash may cost a second, whatever the size."""

    def end_chunk(self) -> None:
        """Write what waits as a chunk of its own."""
        self._Writer__finalize_chunk()  # type: ignore[attr-defined]


class Recording:
    """Writes one MCAP file, row by row. Use as a context manager. Raises InputError where nothing can be written."""

    def __init__(self, path: Path) -> None:
        """An earlier file of that name is replaced; who must not lose it asks first."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, _ONLY_ITS_OWNER)
            if hasattr(os, "fchmod"):  # one that is replaced keeps its mode otherwise
                os.fchmod(descriptor, _ONLY_ITS_OWNER)
            self._file = os.fdopen(descriptor, "wb")
        except OSError as error:
            raise InputError(f"recording {path}: {error.strerror}; name a folder that can be written") from None
        self.path = path
        self._writer = _ChunkWriter(self._file, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library="hilbridge")
        self._channels: dict[str, int] = {}
        self._sequence = 0
        self._chunk_from_ns: int | None = None
        self._wall_minus_log_ns = 0

    def write(self, row: Row) -> None:
        """Append one row. Equal rows are equal bytes. Raises OSError where the disk is full or gone."""
        topic = row.topic
        if isinstance(row, MetaRow):
            self._wall_minus_log_ns = row.wall_minus_monotonic_ns or 0
        channel = self._channels.get(topic)
        if channel is None:
            schema = json.dumps(json_schema(topic)).encode()
            schema_id = self._writer.register_schema(topic.strip("/"), "jsonschema", schema)
            channel = self._channels[topic] = self._writer.register_channel(topic, "json", schema_id)
        if self._chunk_from_ns is None:
            self._chunk_from_ns = row.time_ns
        elif row.time_ns - self._chunk_from_ns >= _CHUNK_NS:
            self.flush()
            self._chunk_from_ns = row.time_ns
        self._sequence += 1
        published_ns = row.time_ns + self._wall_minus_log_ns
        self._writer.add_message(channel, row.time_ns, encode(row), published_ns, self._sequence)

    def flush(self) -> None:
        """End the chunk under way, so that what was written so far survives this process."""
        self._writer.end_chunk()
        self._file.flush()

    def close(self) -> None:
        """Finish the file. Raises OSError; what had been flushed can be read all the same."""
        try:
            self._writer.finish()  # type: ignore[no-untyped-call]  # mcap annotates all but this one
        finally:
            self._file.close()

    def discard(self) -> None:
        """Remove what was written."""
        self._file.close()
        self.path.unlink(missing_ok=True)

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class BackgroundRecording:
    """A recording with a writing thread of its own, so that a slow disk never delays a tick. Lost rows are counted."""

    def __init__(self, path: Path) -> None:
        self._recording = Recording(path)
        self._rows: queue.Queue[Row | None] = queue.Queue(_QUEUE_ROWS)
        self._thread = threading.Thread(target=self._drain, name="recording", daemon=True)
        self._failure: Exception | None = None
        self._discarded = False
        self.lost_rows = 0
        self._thread.start()

    @property
    def path(self) -> Path:
        return self._recording.path

    def write(self, row: Row) -> None:
        """Hand one row over; where the disk is too slow or has failed it is lost, and counted."""
        if self._failure is not None:
            self.lost_rows += 1
            return
        try:
            self._rows.put_nowait(row)
        except queue.Full:
            self.lost_rows += 1

    def close(self) -> None:
        """Write what waits and close the file. Raises InputError with what the disk said."""
        self._rows.put(None)
        self._thread.join()
        if self._failure is not None:
            raise InputError(
                f"recording {self.path}: {self._failure}; {self.lost_rows} rows were lost, what was written before can "
                "be read; is the disk full?"
            )

    def discard(self) -> None:
        """Remove the file: what it belongs to never began."""
        self._discarded = True
        self._rows.put(None)
        self._thread.join()

    def _drain(self) -> None:
        take_level(Level.ORDINARY)
        while (row := self._rows.get()) is not None:
            if self._failure is not None:
                self.lost_rows += 1
                continue
            try:
                self._recording.write(row)
            except (OSError, ValueError, TypeError, struct.error) as failure:
                self._failure = failure
        try:
            if self._discarded:
                self._recording.discard()
            else:
                self._recording.close()
        except OSError as failure:
            self._failure = self._failure or failure
