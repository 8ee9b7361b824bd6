"""CAN logs people use: candump `.log`, Vector `.asc` and `.blf`, ASAM `.mf4`, through python-can's readers and writers.

`.mf4` needs the extra `mdf` (asammdf, LGPL-3.0-or-later: a separate package that this one only imports).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import can

from hilbridge.errors import InputError, needs_extra
from hilbridge.records import Frame

SUFFIXES = (".log", ".asc", ".blf", ".mf4")


def _check(path: Path) -> None:
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: not a CAN log by its name; use one of {', '.join(SUFFIXES)}")
    if path.suffix.lower() == ".mf4":
        with needs_extra("mdf"):
            import asammdf  # noqa: F401


def read_log(path: Path) -> Iterator[Frame]:
    """The frames of a log, error frames among them; `wall_ns` is the stamp in the file (Unix time, or from its start).

    Raises InputError for a name, a file or a content that cannot be read, also in the middle.
    """
    _check(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; give the path of a CAN log")
    options: dict[str, Any] = {"relative_timestamp": False} if path.suffix.lower() == ".asc" else {}
    count = 0
    try:
        with can.LogReader(path, **options) as reader:
            for message in reader:
                yield frame_of_message(message)
                count += 1
    except Exception as error:  # each format's reader raises kinds of its own
        raise InputError(f"{path}: cannot be read after {count} frames ({error}); is it complete?") from error


def write_log(path: Path, frames: Iterable[Frame], *, channel: str = "can0") -> int:
    """Write frames (stamped with `wall_ns`) to a log; gives how many. Nothing is left half-written.

    Raises InputError for a name that is no log's and for a folder that cannot be written to, and what `frames` raises.
    """
    _check(path)
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    count = 0
    try:
        with can.Logger(part) as logger:
            for frame in frames:
                logger(message_of_frame(frame, channel=channel))
                count += 1
        part.replace(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; choose a folder that exists and can be written to") from error
    finally:
        part.unlink(missing_ok=True)
    return count


def convert(source: Path, target: Path) -> int:
    """Copy a log into another format, both told by the names; gives the number of frames. Raises InputError."""
    return write_log(target, read_log(source))


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
