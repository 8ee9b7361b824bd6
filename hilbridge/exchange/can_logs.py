"""Recorded CAN as logs of other programs, and their logs as recordings. Frames are streamed, never listed."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from hilbridge.bus.logs import losses, read_messages, write_messages
from hilbridge.bus.quick_can import can
from hilbridge.errors import InputError
from hilbridge.observe.reading import read_recording
from hilbridge.observe.recording import Recording
from hilbridge.rows import CanRow, Direction, MetaRow, Row

LOG_SUFFIXES = {"blf": ".blf", "asc": ".asc", "mf4": ".mf4", "candump": ".log", "trc": ".trc"}
_REORDER_NS = 2_000_000_000  # a frame is recorded when it is dealt with, up to so long after it came
_LAST_NS = 1 << 62
Progress = Callable[[], None]


class Exchanged(NamedTuple):
    """What came of it: how many frames or rows, what the format could not hold, what the source lacks."""

    path: Path
    rows: int
    lost: dict[str, int]
    missing: str | None = None


def export_log(recording: Path, target: Path, progress: Progress = lambda: None) -> Exchanged:
    """Write a recording's CAN frames, sent and received, as a log. Raises InputError."""
    reader = read_recording(recording, ("/can", "/meta"))
    lost: Counter[str] = Counter()
    suffix = target.suffix.lower()

    def held(messages: Iterable[can.Message]) -> Iterator[can.Message]:
        for message in messages:
            loss = losses(message, suffix)
            if loss is not None:
                lost[loss] += 1
            yield message
            progress()

    count = write_messages(target, held(_in_order(reader)))
    return Exchanged(target, count, dict(lost), reader.missing)


def _in_order(rows: Iterable[Row]) -> Iterator[can.Message]:
    """The frames by the time at which they were on the bus."""
    wall_minus_monotonic_ns, number, newest_ns = 0, 0, 0
    waiting: list[tuple[int, int, CanRow]] = []
    for row in rows:
        if isinstance(row, MetaRow):
            wall_minus_monotonic_ns = row.wall_minus_monotonic_ns or 0
        elif isinstance(row, CanRow):
            stamp_ns = row.wall_ns or (row.received_ns or row.time_ns) + wall_minus_monotonic_ns
            newest_ns, number = max(newest_ns, stamp_ns), number + 1
            heapq.heappush(waiting, (stamp_ns, number, row))
            while waiting[0][0] < newest_ns - _REORDER_NS:
                yield _next(waiting)
    while waiting:
        yield _next(waiting)


def _next(waiting: list[tuple[int, int, CanRow]]) -> can.Message:
    stamp_ns, _, row = heapq.heappop(waiting)
    return message_of_row(row, stamp_ns)


def message_of_row(row: CanRow, stamp_ns: int) -> can.Message:
    """A recorded frame as python-can has it."""
    return can.Message(
        timestamp=stamp_ns / 1e9,
        arbitration_id=row.can_id,
        is_extended_id=row.is_extended,
        is_remote_frame=row.is_remote,
        is_error_frame=row.is_error,
        channel=row.channel or "can0",
        dlc=(row.asked_length or 0) if row.is_remote else len(row.data),
        data=None if row.is_remote else row.data,
        is_fd=row.is_fd,
        is_rx=row.direction is Direction.RX,
        bitrate_switch=bool(row.switches_rate),
        error_state_indicator=bool(row.sender_passive),
    )


def row_of_message(message: can.Message, stamp_ns: int) -> CanRow:
    """A frame of a log as it is recorded; what a log says of a frame is kept, what it does not say is absent."""
    channel = message.channel
    return CanRow(
        stamp_ns,
        Direction.RX if message.is_rx else Direction.TX,
        message.arbitration_id,
        b"" if message.is_remote_frame else bytes(message.data),
        received_ns=stamp_ns if message.is_rx else 0,
        wall_ns=stamp_ns,
        is_error=message.is_error_frame,
        is_extended=message.is_extended_id,
        is_fd=message.is_fd,
        is_remote=message.is_remote_frame,
        channel=channel if isinstance(channel, str) else f"can{channel or 0}",
        switches_rate=message.bitrate_switch if message.is_fd else None,
        sender_passive=message.error_state_indicator if message.is_fd else None,
        asked_length=message.dlc if message.is_remote_frame else None,
    )


def rows_of_log(log: Path) -> Iterator[CanRow]:
    """The frames of a log as rows, stamps to the microsecond. Raises InputError."""
    for count, message in enumerate(read_messages(log)):
        stamp_ns = round(message.timestamp * 1e6) * 1000
        if not 0 <= stamp_ns < _LAST_NS:
            raise InputError(f"{log}: frame {count + 1} has the impossible time {message.timestamp}; is it damaged?")
        yield row_of_message(message, stamp_ns)


def import_rows(rows: Iterable[CanRow], source: Path, target: Path, progress: Progress = lambda: None) -> Exchanged:
    """Make a recording of them; its clock is the log's own. Nothing is left where that fails. Raises InputError."""
    recording, count = None, 0
    try:
        for row in rows:
            if recording is None:
                recording = Recording(target)
                recording.write(MetaRow(row.time_ns, title=f"imported from {source.name}", wall_minus_monotonic_ns=0))
            recording.write(row)
            count += 1
            progress()
        if recording is None:
            raise InputError(f"{source}: no CAN frame in it; is it the right log?")
        recording.close()
    except BaseException:
        if recording is not None:
            recording.discard()
        raise
    return Exchanged(target, count, {})
