"""candump's log format (`candump -l`, `-L`), line by line: all that a line says comes back, and goes out again."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TextIO

from hilbridge.bus.quick_can import can

_ERROR_FLAG, _ERROR_MASK = 0x20000000, 0x1FFFFFFF
_BRS, _ESI = 1, 2
_BASE_DIGITS = 3
_LINE = re.compile(
    r"\((?P<stamp>\d+\.\d+)\)\s+(?P<channel>\S+)\s+(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#"
    r"(?:#(?P<flags>[0-9A-Fa-f])(?P<fd>(?:[0-9A-Fa-f]{2})*)|R(?P<remote>[0-9A-Fa-f]?)"
    r"|(?P<data>(?:[0-9A-Fa-f]{2}){0,8})(?:_[0-9A-Fa-f])?)(?:\s+(?P<direction>[RT]))?\s*"
)


def read_candump(file: TextIO) -> Iterator[can.Message]:
    """The messages of a log. Raises ValueError naming the line that is none."""
    for number, line in enumerate(file, 1):
        if line.strip():
            found = _LINE.fullmatch(line.strip())
            if found is None:
                raise ValueError(f"line {number} is no candump line: {line.strip()[:60]!r}")
            yield _message(found)


def _message(found: re.Match[str]) -> can.Message:
    number, flags, remote = int(found["id"], 16), int(found["flags"] or "0", 16), found["remote"]
    is_error = len(found["id"]) > _BASE_DIGITS and bool(number & _ERROR_FLAG)
    data = bytes.fromhex(found["fd"] or found["data"] or "")
    return can.Message(
        timestamp=float(found["stamp"]),
        arbitration_id=number & _ERROR_MASK,
        is_extended_id=len(found["id"]) > _BASE_DIGITS and not is_error,
        is_error_frame=is_error,
        is_remote_frame=remote is not None,
        is_fd=found["flags"] is not None,
        bitrate_switch=bool(flags & _BRS),
        error_state_indicator=bool(flags & _ESI),
        dlc=int(remote or "0", 16) if remote is not None else len(data),
        data=None if remote is not None else data,
        channel=found["channel"],
        is_rx=found["direction"] != "T",
    )


def candump_line(message: can.Message) -> str:
    """The message as candump writes it."""
    number = message.arbitration_id | (_ERROR_FLAG if message.is_error_frame else 0)
    wide = message.is_extended_id or message.is_error_frame
    name = f"{number:08X}" if wide else f"{number:03X}"
    data = bytes(message.data).hex().upper()
    if message.is_remote_frame:
        body = f"#R{message.dlc:X}" if message.dlc else "#R"
    elif message.is_fd:
        flags = (_BRS if message.bitrate_switch else 0) | (_ESI if message.error_state_indicator else 0)
        body = f"##{flags:X}{data}"
    else:
        body = f"#{data}"
    channel = message.channel if isinstance(message.channel, str) else f"can{message.channel or 0}"
    return f"({message.timestamp:.6f}) {channel} {name}{body} {'R' if message.is_rx else 'T'}\n"
