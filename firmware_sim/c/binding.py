"""The C controller from Python: a state that steps itself, read like the reference's.

It is built at install time where there is a C compiler; `available()` says whether it is there and of these sources.
"""

from __future__ import annotations

import hashlib
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firmware_sim.c.flat import flat, state_of
from firmware_sim.memory import ControllerState, Inputs, Refusal
from firmware_sim.profiles import shipped
from firmware_sim.states import Reason, State

if TYPE_CHECKING:
    from firmware_sim.c import _native
else:
    try:
        from firmware_sim.c import _native
    except ImportError:  # no compiler when this was installed
        _native = None

_HOME = Path(__file__).parent
_FIELDS = {field.name for field in fields(ControllerState)}


def sources_digest() -> str:
    """Of every C file here, as setup.py bakes it in."""
    files = sorted([*_HOME.glob("*.c"), *_HOME.glob("*.h")])
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


def why_not() -> str | None:
    """Why the C controller cannot be used, and the cure; None where it can."""
    if _native is None:
        return "not built: install a C compiler, then `pip install -e .` again"
    if sources_digest() != _native.DIGEST:
        return "built from other sources: `pip install -e .` again"
    if shipped().hash32 != _native.PROFILES_HASH:
        return (
            "has other profiles than profiles.toml: `python -m firmware_sim.c.generate`, then `pip install -e .` again"
        )
    return None


def available() -> bool:
    """Whether the C controller is there, built from the sources beside it."""
    return _native is not None and why_not() is None


if _native is not None:
    _native.use_members(tuple(State), tuple(Reason), tuple(Refusal))

    class CController(_native.Controller):
        """All memory of the C controller. What is asked in every tick comes straight from C, the rest by `reference`."""

        def reference(self) -> ControllerState:
            """The same state as the reference has it, a copy."""
            return state_of(self.dump())

        def __getattr__(self, name: str) -> Any:
            if name not in _FIELDS:
                raise AttributeError(name)
            return getattr(self.reference(), name)


def advance_in_c(state: ControllerState, inputs: Inputs, now_ms: int) -> None:
    """`controller.advance`, by the C: for tests that make and change states of the reference."""
    c = CController(bytes(16), 0)
    c.load(flat(state))
    c.advance(inputs, now_ms)
    after = c.reference()
    for field in fields(ControllerState):
        setattr(state, field.name, getattr(after, field.name))
