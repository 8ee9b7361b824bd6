"""CAN logs people use: candump `.log`, Vector `.asc` and `.blf`, ASAM `.mf4`, PEAK `.trc`, mostly by python-can's means.

`.mf4` needs the extra `mdf` (asammdf, LGPL-3.0-or-later: a separate package that this one only imports).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from hilbridge.bus.candump_text import candump_line, read_candump
from hilbridge.bus.mf4_batches import in_batches
from hilbridge.bus.quick_can import can, load_mf4
from hilbridge.bus.trc_text import trc_writer
from hilbridge.errors import InputError, needs_extra
from hilbridge.records import Frame

SUFFIXES = (".log", ".asc", ".blf", ".mf4", ".trc")
_TEXTS = (".log", ".asc", ".trc")


def _check(path: Path) -> None:
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: not a CAN log by its name; use one of {', '.join(SUFFIXES)}")
    if path.suffix.lower() == ".mf4":
        with needs_extra("mdf"):
            load_mf4()


def read_log(path: Path) -> Iterator[Frame]:
    """The frames of a log, error frames among them; `wall_ns` is the stamp in the file (Unix time, or from its start).

    A Frame has no channel, direction, BRS, ESI or asked-for length: `convert` keeps those that the formats have. Raises
    InputError for a name, a file or a content that cannot be read, also in the middle, and where no line is understood.
    """
    return map(frame_of_message, read_messages(path))


def read_messages(path: Path) -> Iterator[can.Message]:
    """As `read_log`, with all that python-can's message holds."""
    _check(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; give the path of a CAN log")
    count = 0
    try:
        for message in _reader(path):
            yield message
            count += 1
    except Exception as error:  # each format's reader raises kinds of its own
        raise InputError(f"{path}: cannot be read after {count} frames ({error}); is it complete?") from error
    if count == 0 and path.suffix.lower() in _TEXTS and _has_events(path):
        raise InputError(f"{path}: no line of it is understood as a CAN frame; is it a {path.suffix} log?")


def _reader(path: Path) -> Iterator[can.Message]:
    if path.suffix.lower() == ".log":
        with path.open(encoding="utf-8-sig") as file:
            yield from read_candump(file)
        return
    options: dict[str, Any] = {"relative_timestamp": False} if path.suffix.lower() == ".asc" else {}
    with can.LogReader(path, **options) as reader:
        total_s = 0.0
        for message in reader:
            if getattr(reader, "timestamps_format", None) == "relative":  # each stamp counts from the one before
                start_s = float(getattr(reader, "start_time", 0.0) or 0.0)
                total_s += message.timestamp - start_s
                message.timestamp = start_s + total_s
            yield _as_the_file_means(message, path.suffix.lower())


def _as_the_file_means(message: can.Message, suffix: str) -> can.Message:
    """PEAK counts buses from one, and its length codes are no lengths; FD has no remote frames, only empty ones."""
    if message.is_fd:
        message.is_remote_frame = False
    if suffix == ".trc":
        if isinstance(message.channel, int) and message.channel > 0:
            message.channel -= 1
        if not message.is_remote_frame:
            message.dlc = len(message.data)
    return message


def losses(message: can.Message, suffix: str) -> str | None:
    """What a log of this kind cannot hold of a frame, in words; None where it holds all."""
    if message.is_error_frame and suffix == ".trc":
        return "error frames"
    if message.is_error_frame and suffix == ".asc" and (message.arbitration_id or any(message.data)):
        return "error frames' classes and data"
    if message.is_error_frame and suffix == ".blf" and not message.is_rx:
        return "error frames' direction"
    return None


def _has_events(path: Path) -> bool:
    """Whether a text log without frames has lines that look like some: a number first."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        return any(line.strip()[:1].isdigit() or line.strip()[:1] == "(" for line in file)


def write_log(path: Path, frames: Iterable[Frame], *, channel: str = "can0") -> int:
    """Write frames (stamped with `wall_ns`) to a log; gives how many. Nothing is left half-written.

    Raises InputError for a name that is no log's and for a folder that cannot be written to, and what `frames` raises.
    """
    return write_messages(path, (message_of_frame(frame, channel=channel) for frame in frames))


def write_messages(path: Path, messages: Iterable[can.Message]) -> int:
    """As `write_log`, of python-can's messages."""
    _check(path)
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    count = 0
    write: Callable[[can.Message], object] | None = None
    try:
        with ExitStack() as open_files:
            for message in messages:
                write = write or _writer(part, message, open_files)
                write(message)
                count += 1
            if write is None:  # a log without frames is one, too
                _writer(part, can.Message(), open_files)
        part.replace(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; choose a folder that exists and can be written to") from error
    finally:
        part.unlink(missing_ok=True)
    return count


def _writer(part: Path, first: can.Message, open_files: ExitStack) -> Callable[[can.Message], object]:
    """What writes a log of this name that begins with `first`."""
    suffix = part.suffix.lower()
    if suffix in (".log", ".trc"):
        file = open_files.enter_context(part.open("w", encoding="utf-8"))
        return trc_writer(file) if suffix == ".trc" else lambda message: file.write(candump_line(message))
    logger = open_files.enter_context(can.Logger(part))
    if isinstance(logger, can.ASCWriter):  # its stamps count from a start that has whole milliseconds
        logger.log_event("Start of measurement", math.floor(first.timestamp * 1e3) / 1e3)
    return in_batches(logger) if isinstance(logger, can.MF4Writer) else logger


def convert(source: Path, target: Path) -> int:
    """Copy a log into another format, both told by the names; gives the number of frames. Channel, direction, BRS and ESI
    go with it where the formats have them. Raises InputError.
    """
    return write_messages(target, read_messages(source))


def frame_of_message(message: can.Message) -> Frame:
    """A python-can message out of a file."""
    return Frame(
        message.arbitration_id,
        bytes(message.data),
        wall_ns=round(message.timestamp * 1e6) * 1000,  # a float holds no more than the microseconds
        is_error=message.is_error_frame,
        is_fd=message.is_fd,
        is_extended=message.is_extended_id,
        is_remote=message.is_remote_frame,
    )


def message_of_frame(frame: Frame, *, channel: str | int = "can0") -> can.Message:
    """A frame as a python-can message to log."""
    return can.Message(
        timestamp=frame.wall_ns / 1e9,
        arbitration_id=frame.can_id,
        data=frame.data,
        is_extended_id=frame.is_extended,
        is_error_frame=frame.is_error,
        is_fd=frame.is_fd,
        bitrate_switch=frame.is_fd,
        is_remote_frame=frame.is_remote,
        channel=channel,
    )
