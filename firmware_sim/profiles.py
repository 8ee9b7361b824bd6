"""Verb -> assist profile (docs/safety.md). The numbers await clinical sign-off; nobody has worn them.

Integers throughout: damping in mN m s/rad, torque in uN m, times in ms, gravity in percent. `band_per_mille` is the
coefficient of the 1 kHz low pass whose residue is damped: 2 pi f / 1000 for a corner at f; 0 damps the whole velocity.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple


class Guidance(IntEnum):
    """What pushes along with the wearer's own movement."""

    NEVER = 0
    MINIMUM_JERK = 1
    UNTIL_CONTACT = 2


class Profile(NamedTuple):
    """How one verb is assisted. `cap_unm` == 0 means never: an ACT for it counts as HOLD."""

    damping: int
    damping_near: int
    drag_unm: int
    half_wave_ms: int
    gravity_per_mille: int
    guidance: Guidance
    cap_unm: int
    ramp_in_ms: int
    ramp_out_ms: int


NONE = Profile(0, 0, 0, 0, 0, Guidance.NEVER, 0, 1, 1)
_REACH = Profile(3000, 5000, 30_000, 180, 20, Guidance.MINIMUM_JERK, 2_000_000, 300, 200)
_OPEN = Profile(3000, 3000, 30_000, 180, 16, Guidance.UNTIL_CONTACT, 1_500_000, 300, 150)
_POUR = Profile(5000, 5000, 30_000, 180, 40, Guidance.NEVER, 2_000_000, 400, 500)
_CUT = Profile(3000, 3000, 0, 143, 0, Guidance.NEVER, 1_000_000, 300, 150)  # above 3.5 Hz
_MIX = Profile(3000, 3000, 0, 125, 16, Guidance.NEVER, 1_000_000, 400, 200)  # above 4 Hz
_INSPECT = Profile(5000, 5000, 30_000, 180, 40, Guidance.NEVER, 1_500_000, 400, 300)
_OPERATE = Profile(2000, 2000, 30_000, 180, 0, Guidance.NEVER, 1_000_000, 300, 150)

_BY_CODE: dict[int, Profile] = {
    1: _REACH,  # Take
    2: _REACH,  # Put
    3: _OPEN,  # Open
    4: _CUT,  # Cut
    # 5, Move Around, never
    6: _INSPECT,  # Inspect/Read
    7: _OPEN,  # Close
    8: _MIX,  # Wash
    9: _REACH,  # Transfer
    10: _POUR,  # Pour
    11: _MIX,  # Clean/Wipe
    12: _CUT,  # Divide/Pull Apart
    13: _OPEN,  # Turn on
    14: _OPERATE,  # Operate
    15: _MIX,  # Mix
    16: _CUT,  # Squeeze
    17: _MIX,  # Spread
    18: _OPEN,  # Turn off
    19: _CUT,  # Compress
    20: _MIX,  # Dry
    21: _CUT,  # Crack
}


def profile(verb_code: int) -> Profile:
    """Profile of a verb code; whatever is not listed is never assisted."""
    return _BY_CODE.get(verb_code, NONE)
