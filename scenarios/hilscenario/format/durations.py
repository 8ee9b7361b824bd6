"""Times in scenario files: a number and its unit, `150 ms` or `2.5 s`. A bare number has no unit and is refused."""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import BeforeValidator, PlainSerializer, WithJsonSchema

_PATTERN = r"^\s*(\d+(?:\.\d+)?)\s*(us|ms|s|min)\s*$"
_NS = {"us": 1_000, "ms": 1_000_000, "s": 1_000_000_000, "min": 60_000_000_000}


def parse_duration_ns(value: Any) -> int:
    """Nanoseconds of a text such as `40 ms`. Raises ValueError naming the value and the form.

    Zero needs no unit.
    """
    if value == 0 and not isinstance(value, bool):
        return 0
    match = re.match(_PATTERN, value) if isinstance(value, str) else None
    if match is None:
        raise ValueError(f"{value!r} is no time; write a number and its unit, such as 150 ms or 2.5 s")
    return round(float(match[1]) * _NS[match[2]])


def format_duration(value_ns: int) -> str:
    """The shortest text that `parse_duration_ns` reads back."""
    for unit in ("s", "ms", "us"):
        scaled = value_ns / _NS[unit]
        if scaled >= 1 or unit == "us":
            text = f"{scaled:.9f}".rstrip("0").rstrip(".")
            if round(float(text) * _NS[unit]) == value_ns:
                return f"{text} {unit}"
    return f"{value_ns / 1e9:.9f} s"


Duration = Annotated[
    int,
    BeforeValidator(parse_duration_ns),
    PlainSerializer(format_duration, return_type=str),
    WithJsonSchema({"type": "string", "pattern": _PATTERN, "examples": ["150 ms", "2.5 s"]}),
]
