"""A defect in the program under test, for as long as a test wants it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any


@contextmanager
def spoilt(places: Sequence[tuple[Any, Any, Any]]) -> Iterator[None]:
    """(owner, attribute or key, value) in place of what stands there."""
    before = [(owner, name, _read(owner, name)) for owner, name, _ in places]
    try:
        for owner, name, value in places:
            _write(owner, name, value)
        yield
    finally:
        for owner, name, value in before:
            _write(owner, name, value)


def _read(owner: Any, name: Any) -> Any:
    return owner[name] if isinstance(owner, dict) else getattr(owner, name)


def _write(owner: Any, name: Any, value: Any) -> None:
    if isinstance(owner, dict):
        owner[name] = value
    else:
        setattr(owner, name, value)
