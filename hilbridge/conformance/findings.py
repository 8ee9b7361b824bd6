"""What a case of the conformance test comes to. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import NamedTuple

from hilbridge.wire.dbc import Value


class Verdict(StrEnum):
    """KEPT; BROKEN; UNSHOWN: it could not be tried, which is no pass."""

    KEPT = "kept"
    BROKEN = "broken"
    UNSHOWN = "not shown"


class Finding(NamedTuple):
    """One line of the table: the case's name, what it claims, and what was seen."""

    name: str
    claim: str
    verdict: Verdict
    seen: str
    seconds: float


class Heard(NamedTuple):
    """One accepted message of the device and when it arrived."""

    at_ns: int
    name: str
    signals: Mapping[str, Value]
    counter: int


class Broken(Exception):
    """The device does not keep the contract; the text is what was seen."""


class Unshown(Exception):
    """The case cannot be tried; the text is why, and what would help."""


def demand(holds: bool, otherwise: str) -> None:
    """Raise Broken unless it holds."""
    if not holds:
        raise Broken(otherwise)
