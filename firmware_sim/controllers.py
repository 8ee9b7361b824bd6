"""The two controllers and how each is powered on and stepped: `python` is the reference, `c` the same in C where built.

`python -m firmware_sim.controllers` says whether the C is there.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

from firmware_sim.c import binding
from firmware_sim.controller import advance
from firmware_sim.memory import ControllerState, Inputs
from firmware_sim.profiles import Profiles, shipped
from firmware_sim.watchdogs import Limits

Step = Callable[[ControllerState, Inputs, int], None]
CONTROLLERS = ("python", "c")


class ControllerUnusable(ValueError):
    """There is no such controller here; the message is one line with the cure."""


def power_on(
    controller: str, key: bytes, boot_nonce: int, limits: Limits | None = None, profiles: Profiles | None = None
) -> ControllerState:
    """The state at power-on, with the profiles that ship unless others are given. One of C is no ControllerState but is
    read as one.

    Raises ControllerUnusable.
    """
    if controller not in CONTROLLERS:
        raise ControllerUnusable(f"controller {controller!r}: there are {' and '.join(CONTROLLERS)}")
    own = profiles or shipped()
    if controller == "python":
        return ControllerState(key, boot_nonce, limits or Limits(), own)
    if own != shipped():
        raise ControllerUnusable(
            "controller 'c': its profiles are compiled in; use --controller python, or put them into "
            "firmware_sim/profiles.toml, then `python -m firmware_sim.c.generate` and `pip install -e .`"
        )
    if (why := binding.why_not()) is not None:
        raise ControllerUnusable(f"controller 'c': {why}")
    return cast(ControllerState, binding.CController(key, boot_nonce, limits or Limits()))


def quickest() -> str:
    """The C where it is built; it gives the same bytes in less time."""
    return "c" if binding.available() else "python"


def name_of(state: ControllerState) -> str:
    """Which of the two this state belongs to."""
    return "python" if isinstance(state, ControllerState) else "c"


def step_of(state: ControllerState) -> Step:
    """What steps this state, in place."""
    return advance if isinstance(state, ControllerState) else cast(Step, type(state).advance)


if __name__ == "__main__":
    print(binding.why_not() or "built")  # noqa: T201
