"""What a latched or stopped controller still waits for, in words for whoever stands before it. Pure."""

from __future__ import annotations

from firmware_sim.memory import ControllerState
from firmware_sim.states import ESTOP, LATCHED

BRIDGE = "a bridge that authenticates clearing: hilbridge run --clear-latch"
HOLD = "HOLD from the bridge"
REST = "its torque to come to rest"
HAND = "a hand at the device: clear (with --interactive, or on a pipe), or SIGUSR1"


def awaited(state: ControllerState, now_ms: int) -> str | None:
    """The next step of clearing; None where there is nothing to clear."""
    if state.state not in (LATCHED, ESTOP):
        return None
    if now_ms >= state.clear_until_ms:
        return BRIDGE
    if not (state.command_live and state.command_is_hold):
        return HOLD
    if state.torque.assist_unm or state.torque.gravity_unm:
        return REST
    return HAND
