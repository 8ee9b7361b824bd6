"""Writes one recording: MCAP with JSON messages, so that Foxglove, `mcap` and ten lines of Python can read it.

A recording survives its writer: it is written in place, in chunks of half a second, each handed to the system at
once. Whatever ends the process, what stands in the file up to the last chunk can be read (`observe.reading`).

Log times are the monotonic stamps of when the bridge had what happened, publish times the wall clock where the run's
MetaRow knows it. In virtual time they are the same, so the same run gives the same bytes.
"""

from __future__ import annotations

import errno
import json
import os
import threading
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

from hilbridge.errors import InputError
from hilbridge.observe.mcap_file import McapFile
from hilbridge.priority import Level, take_level
from hilbridge.rows import MetaRow, Row, encode, json_schema, schema_name

_CHUNK_NS = 500_000_000
_CHUNK_BYTES = 1 << 20
_ONLY_ITS_OWNER = 0o600  # a recording is of a person
LIBRARY = "hilbridge"


class Adds(Protocol):
    """What a recording adds to the rows that it is given (`observe.signals`), and the schemas of those topics."""

    @property
    def schemas(self) -> Mapping[str, dict[str, Any]]: ...

    def of(self, row: Row) -> Row | None: ...


class AddsNothing:
    """Rows as they come; `schemas` of topics that the rows' own records do not know."""

    def __init__(self, schemas: Mapping[str, dict[str, Any]] | None = None) -> None:
        self.schemas: Mapping[str, dict[str, Any]] = {} if schemas is None else schemas

    def of(self, row: Row) -> Row | None:
        """Nothing."""
        return None


class _Syncer:
    """Forces what was written onto the disk, in a thread of its own: a disk that takes seconds for that must not hold up
    what is written next, which a kill would cost.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = os.dup(descriptor)
        self._asked = threading.Event()
        self._ending = False
        self._failure: OSError | None = None
        threading.Thread(target=self._run, name="recording sync", daemon=True).start()

    def ask(self) -> None:
        """Soon. Raises OSError with what the disk said the last time."""
        if self._failure is not None:
            raise self._failure
        self._asked.set()

    def end(self) -> None:
        """Once more, and no more. Nobody waits for it."""
        self._ending = True
        self._asked.set()

    def _run(self) -> None:
        take_level(Level.ORDINARY)  # whoever began the next part of a recording may be above that
        ending = False
        while not ending:
            self._asked.wait()
            self._asked.clear()
            ending = self._ending
            try:
                os.fsync(self._descriptor)
            except OSError as error:
                self._failure = error
        os.close(self._descriptor)


class Recording:
    """Writes one MCAP file, row by row. Use as a context manager. Raises InputError where nothing can be written.

    `is_lasting`: each chunk is forced onto the disk soon, so that a power cut costs little more than a kill.
    """

    def __init__(self, path: Path, adds: Adds | None = None, *, is_lasting: bool = False) -> None:
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
        self._adds: Adds = AddsNothing() if adds is None else adds
        self._syncer = _Syncer(descriptor) if is_lasting else None
        self._mcap = McapFile(self._file, LIBRARY)
        self._channels: dict[str, int] = {}
        self._sequence = 0
        self._chunk_from_ns: int | None = None
        self._wall_minus_log_ns = 0

    @property
    def size(self) -> int:
        """Bytes handed over so far."""
        return self._file.tell()

    def write(self, row: Row) -> None:
        """Append one row, and what is added to it. Equal rows are equal bytes. Raises OSError where the disk is full."""
        self._append(row)
        if (added := self._adds.of(row)) is not None:
            self._append(added)

    def _append(self, row: Row) -> None:
        topic = row.topic
        if isinstance(row, MetaRow):
            self._wall_minus_log_ns = row.wall_minus_monotonic_ns or 0
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channels[topic] = self._register(topic)
        if self._chunk_from_ns is None:
            self._chunk_from_ns = row.time_ns
        elif row.time_ns - self._chunk_from_ns >= _CHUNK_NS or self._mcap.chunk_bytes >= _CHUNK_BYTES:
            self.flush()
            self._chunk_from_ns = row.time_ns
        self._sequence += 1
        self._mcap.add_message(channel, row.time_ns, row.time_ns + self._wall_minus_log_ns, self._sequence, encode(row))

    def _register(self, topic: str) -> int:
        known = self._adds.schemas.get(topic)
        schema = json.dumps(json_schema(topic) if known is None else known).encode()
        return self._mcap.add_channel(topic, schema_name(topic), schema)

    def flush(self) -> None:
        """End the chunk under way, so that what was written so far survives this process."""
        self._mcap.end_chunk()
        self._file.flush()
        if self._syncer is not None:
            self._syncer.ask()

    def close(self) -> None:
        """Finish the file. Raises OSError; what had been flushed can be read all the same."""
        try:
            self._mcap.finish()
        finally:
            self._end()

    def discard(self) -> None:
        """Remove what was written."""
        self._end()
        self.path.unlink(missing_ok=True)

    def _end(self) -> None:
        try:
            self._file.close()
        finally:
            if self._syncer is not None:
                self._syncer.end()

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
