"""A DBC file as text in, cantools' database out. What cannot be read is one line with the place and the reason."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hilbridge.errors import InputError

MAX_BYTES = 64 << 20
EXTENDED_BIT = 1 << 31  # a DBC writes a 29-bit identifier with this bit set
_INDEPENDENT_SIGNALS = "VECTOR__INDEPENDENT_SIG_MSG"  # Vector's place for signals of no message
_SHOWN = 3


class DbcError(InputError):
    """The DBC cannot be used; the message is one line naming the file, the place and the cure."""


def dbc_number(can_id: int, *, is_extended: bool) -> int:
    """An identifier as a DBC numbers it, so that base and extended ones of one value stay apart."""
    return can_id | EXTENDED_BIT if is_extended else can_id


def shown_number(number: int) -> str:
    """A DBC number for people, as `shown_id`."""
    return shown_id(number & ~EXTENDED_BIT, is_extended=number >= EXTENDED_BIT)


def shown_id(can_id: int, *, is_extended: bool) -> str:
    """An identifier for people: three digits, or eight where it is extended."""
    return f"{can_id:#010x}" if is_extended else f"{can_id:#05x}"


def read_text(path: Path) -> str:
    """A text file of the field: UTF-8 with or without byte order mark, else Windows-1252. Raises DbcError."""
    try:
        if path.is_file() and path.stat().st_size > MAX_BYTES:
            raise DbcError(f"{path}: larger than {MAX_BYTES >> 20} MB, so no DBC file; give one")
        data = path.read_bytes()
    except FileNotFoundError:
        raise DbcError(f"{path}: no such DBC file; give the path of one, or none for the shipped one") from None
    except OSError as error:
        raise DbcError(f"{path}: {error.strerror}; give the path of a DBC file such as dbc/iassistadl.dbc") from None
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def load_dbc(path: Path) -> Any:
    """cantools' database of a DBC file. Overlapping signals are let pass: whether they matter, the reader decides.

    Raises DbcError with the parser's line and reason.
    """
    from cantools.database.can.database import Database

    text = read_text(path)
    if not re.search(r"^\s*(VERSION|NS_|BU_|BO_|CM_)\b", text, re.MULTILINE) or "\0" in text:
        raise DbcError(f"{path}: no DBC file; give one such as dbc/iassistadl.dbc")
    database: Any = Database(strict=False)
    try:
        database.add_dbc_string(text)
    except Exception as error:  # cantools raises whatever its parser meets
        raise DbcError(f"{path}: {_reason(error, text)}; correct the file") from None
    database.messages[:] = [message for message in database.messages if message.name != _INDEPENDENT_SIGNALS]
    if not database.messages:
        raise DbcError(f"{path}: holds no message; give a DBC file with messages (BO_)")
    return database


def same_identifier(messages: Any) -> dict[int, list[str]]:
    """DBC numbers that more than one message has, with the messages' names."""
    names: dict[int, list[str]] = {}
    for message in messages:
        names.setdefault(dbc_number(message.frame_id, is_extended=message.is_extended_frame), []).append(message.name)
    return {number: found for number, found in names.items() if len(found) > 1}


def _reason(error: Exception, text: str) -> str:
    """What the parser says, on one line, with the line of the file where it can be found."""
    said = " ".join(str(error).split())
    if said.startswith("Invalid syntax at line"):
        return said[0].lower() + said[1:]
    if stale := re.findall(r"VAL_ (\d+) (\w+)", said):
        places = [(f"{signal} of message {n}", rf"VAL_\s+{n}\s+{signal}\b") for n, signal in stale[:_SHOWN]]
        shown = ", ".join(name + _line(text, pattern) for name, pattern in places)
        more = f" and {len(stale) - _SHOWN} more" if len(stale) > _SHOWN else ""
        return f"value table (VAL_) for a signal that is not there: {shown}{more}"
    if isinstance(error, KeyError) and error.args:
        name = str(error.args[0])
        place = _line(text, rf'BA_(DEF_DEF_)?(REL_)?\s+"{re.escape(name)}"') or _line(text, rf"\b{re.escape(name)}\b")
        return f"{name!r} is used but not defined{place}"
    if (named := re.search(r"in message (\w+)", said)) is not None:
        said = said.rstrip(".")
        cure = " (a 29-bit identifier is written plus 0x80000000)" if "more than 11 bits" in said else ""
        place = _line(text, rf"BO_\s+\d+\s+{named[1]}\b")
        return f"{said}{place}{cure}"
    return f"the parser cannot read it ({type(error).__name__}: {said[:200]})"


def _line(text: str, pattern: str) -> str:
    """` (line 12)` for the first line that begins with `pattern`, or nothing."""
    found = re.search(rf"^[ \t]*{pattern}", text, re.MULTILINE)
    return "" if found is None else f" (line {text.count(chr(10), 0, found.start()) + 1})"
