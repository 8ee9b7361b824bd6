"""How a verb is assisted: one profile, and those of all verbs. Integers throughout.

Damping in mN m s/rad, torque in uN m, times in ms. Half waves longer than `half_wave_ms` are no tremor. The numbers are in
profiles.toml.
"""

from __future__ import annotations

from dataclasses import dataclass
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


@dataclass(frozen=True, slots=True)
class Profiles:
    """A profile for each value that a verb on the bus may have; `digest` is the SHA-256 of them all, in hexadecimal."""

    by_code: tuple[Profile, ...]
    digest: str

    def of(self, verb_code: int) -> Profile:
        """Profile of a verb code; whatever is not listed is never assisted."""
        return self.by_code[verb_code] if 0 <= verb_code < len(self.by_code) else NONE

    @property
    def hash32(self) -> int:
        """The first 32 bits of the digest, which the C has, too."""
        return int(self.digest[:8], 16)
