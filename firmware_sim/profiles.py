"""Verb -> assist profile of the file that ships (docs/safety.md). It is read once; no step of the controller reads a file."""

from __future__ import annotations

from functools import cache

from firmware_sim.assist_profile import NONE as NONE
from firmware_sim.assist_profile import Guidance as Guidance
from firmware_sim.assist_profile import Profile as Profile
from firmware_sim.assist_profile import Profiles as Profiles
from firmware_sim.profile_file import read


@cache
def shipped() -> Profiles:
    """Those of profiles.toml. Raises ProfilesUnusable where somebody has spoilt the file."""
    return read()


def profile(verb_code: int) -> Profile:
    """Profile of a verb code; whatever is not listed is never assisted."""
    return shipped().of(verb_code)
