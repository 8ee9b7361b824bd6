"""Gravity support of the wearer's arm. It rises over the profile's ramp and never falls faster than its 500 ms (H3)."""

from __future__ import annotations

from firmware_sim.law.memory import Torque
from firmware_sim.law.numbers import WAY, WAY_TICKS, sine_per_mille
from firmware_sim.profiles import Profile

ARM_WEIGHT_UNM = 2_000_000  # the wearer's forearm held level


def support(torque: Torque, profile: Profile, angle_mdeg: int, scale: int) -> None:
    """One tick of ASSIST: towards the profile's share of the arm's weight, scaled (per mille)."""
    most = ARM_WEIGHT_UNM * profile.gravity_per_mille // 1000
    wanted = most * sine_per_mille(angle_mdeg) // 1000 * scale // 1000
    before = torque.gravity_unm
    if wanted >= before:
        torque.gravity_unm = min(wanted, before + most // profile.ramp_in_ms)
        torque.gravity_top_unm = max(torque.gravity_top_unm, torque.gravity_unm)
    else:
        torque.gravity_unm = max(wanted, before - torque.gravity_top_unm // WAY_TICKS - 1, 0)
    torque.gravity_from_unm = torque.gravity_unm
    torque.gravity_tick = 0


def support_less(torque: Torque) -> None:
    """One tick of the 500 ms in which support fades, on one smooth curve."""
    tick = min(torque.gravity_tick + 1, WAY_TICKS)
    torque.gravity_tick = tick
    torque.gravity_unm = torque.gravity_from_unm * WAY[tick] // 1_000_000
    if tick == WAY_TICKS:
        torque.gravity_top_unm = 0


def support_gone(torque: Torque) -> None:
    """Support ends at once: on STOP, or when the device's own sensors are not to be trusted."""
    torque.gravity_unm = 0
    torque.gravity_from_unm = 0
    torque.gravity_tick = WAY_TICKS
    torque.gravity_top_unm = 0
