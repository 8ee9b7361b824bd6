"""A line put into bridge.toml, where it belongs, and nothing else changed."""

from __future__ import annotations

import re
from pathlib import Path

from hilbridge.config import load_config
from hilbridge.errors import InputError


def put_line(text: str, line: str) -> str:
    """The text with `line` in [sensors]: in place of the one with its key, else first in the table, else in a new table."""
    key = line.partition("=")[0].strip()
    lines = text.splitlines()
    begin = next((n for n, one in enumerate(lines) if re.fullmatch(r"\s*\[sensors\]\s*(#.*)?", one)), None)
    if begin is None:
        return "\n".join([*lines, *([""] if lines else []), "[sensors]", line]) + "\n"
    end = next((n for n in range(begin + 1, len(lines)) if lines[n].lstrip().startswith("[")), len(lines))
    place = next((n for n in range(begin + 1, end) if re.match(rf"\s*{re.escape(key)}\s*=", lines[n])), None)
    if place is None:
        lines.insert(begin + 1, line)
    else:
        lines[place] = line
    return "\n".join(lines) + "\n"


def write_line(path: Path, line: str) -> None:
    """Raises InputError, and leaves the file as it was, where it could not be read as a configuration then."""
    before = path.read_text(encoding="utf-8-sig") if path.is_file() else None
    try:
        path.write_text(put_line(before or "", line), encoding="utf-8")
    except OSError as error:
        raise InputError(f"config {path}: {error.strerror}; put this line into [sensors]: {line}") from None
    try:
        load_config(path)
    except InputError:
        if before is None:
            path.unlink()
        else:
            path.write_text(before, encoding="utf-8")
        raise
