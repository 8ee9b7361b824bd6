"""Recordings as MCAP with JSON messages, so that Foxglove, `mcap` and ten lines of Python can read them.

A recording holds no wall clock of its own: log times are the monotonic stamps of what happened, so the same run in
virtual time gives the same bytes.
"""

from __future__ import annotations

import errno
import json
import os
import queue
import struct
import threading
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from hilbridge.errors import InputError
from hilbridge.priority import Level, take_level
from hilbridge.rows import Row, decode, encode, json_schema

# A minute of everything the bridge says. A disk that is slower than that loses rows, which are counted and shown.
_QUEUE_ROWS = 20_000


class Recording:
    """Writes one MCAP file row by row, beside its place until it is whole: an earlier one stays until then.

    Use as a context manager. Raises InputError where nothing can be written.
    """

    def __init__(self, path: Path) -> None:
        self._partial = path.with_name(path.name + ".part")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
            self._file = self._partial.open("wb")
        except OSError as error:
            raise InputError(f"recording {path}: {error.strerror}; name a folder that can be written") from None
        self.path = path
        self._writer = Writer(self._file, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library="hilbridge")
        self._channels: dict[str, int] = {}
        self._sequence = 0

    def write(self, row: Row) -> None:
        """Append one row. Equal rows are equal bytes."""
        topic = row.topic
        channel = self._channels.get(topic)
        if channel is None:
            schema = json.dumps(json_schema(topic)).encode()
            schema_id = self._writer.register_schema(topic.strip("/"), "jsonschema", schema)
            channel = self._channels[topic] = self._writer.register_channel(topic, "json", schema_id)
        self._sequence += 1
        self._writer.add_message(channel, row.time_ns, encode(row), row.time_ns, self._sequence)

    def close(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]  # mcap annotates all but this one
        self._file.close()
        self._partial.replace(self.path)

    def discard(self) -> None:
        """Remove what was written."""
        self._file.close()
        self._partial.unlink(missing_ok=True)

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
        try:
            self._rows.put_nowait(row)
        except queue.Full:
            self.lost_rows += 1

    def close(self) -> None:
        """Write what waits and close the file. Raises what the disk raised."""
        self._rows.put(None)
        self._thread.join()
        if self._failure is not None:
            raise InputError(f"recording {self.path}: {self._failure}; is the disk full?")

    def discard(self) -> None:
        """Remove the file: what it belongs to never began."""
        self._discarded = True
        self._rows.put(None)
        self._thread.join()

    def _drain(self) -> None:
        take_level(Level.ORDINARY)
        while (row := self._rows.get()) is not None:
            if self._failure is None:
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
            self._failure = failure


def read_recording(path: Path, topics: tuple[str, ...] | None = None) -> Iterator[Row]:
    """Rows in order of time. Raises InputError when the file is no recording, was cut off, or holds other rows."""
    if not path.is_file():
        raise InputError(f"recording {path}: no such file; `hilbridge demo --out DIR` writes DIR/recording.mcap")
    with path.open("rb") as file:
        try:
            for _, channel, message in make_reader(file).iter_messages(topics=topics):
                yield decode(channel.topic, message.log_time, message.data)
        except (McapError, struct.error, ValueError, EOFError) as error:
            raise InputError(f"recording {path}: not a whole recording ({error}); record it again") from None
