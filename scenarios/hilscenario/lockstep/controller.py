"""Which controller a run in virtual time has: the C where it is built, unless HILBRIDGE_CONTROLLER says otherwise.

By the environment, so that worker processes have what their parent has. The recordings are the same to the byte.
"""

from __future__ import annotations

import os

from firmware_sim.controllers import ControllerUnusable, power_on, quickest
from firmware_sim.memory import ControllerState
from hilbridge.errors import InputError

VARIABLE = "HILBRIDGE_CONTROLLER"


def controller_in_use() -> str:
    """`c` or `python`, or whatever the variable holds."""
    return os.environ.get(VARIABLE) or quickest()


def powered_on(key: bytes, boot_nonce: int) -> ControllerState:
    """The controller of a run. Raises InputError where the one asked for is not there."""
    try:
        return power_on(controller_in_use(), key, boot_nonce)
    except ControllerUnusable as error:
        raise InputError(f"{VARIABLE}: {error}") from None
