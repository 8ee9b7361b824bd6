"""Which profile to propose: a plain search over a small grid that only ever takes away. Pure: trials are the caller's.

Of damping the share with the least cost among those that keep every bar; where two are as good, the lesser. Then the lowest
cap that costs nothing. A verb for which nothing keeps the bars is proposed as never assisted.
"""

from __future__ import annotations

from dataclasses import dataclass

from firmware_sim.assist_profile import Profile
from firmware_sim.profile_file import NUMBERS, Kind
from firmware_sim.tuning.trial import Figures, Score

DAMPING_SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)
CAP_SHARES = (0.1, 0.25, 0.5)
MOST_TRIALS = len(DAMPING_SHARES) + len(CAP_SHARES)  # of a profile
AS_GOOD = 0.01  # of cost: less than one person's tremor differs from one minute to the next
_CAP = NUMBERS["cap_mnm"].scale


@dataclass(frozen=True)
class Proposal:
    """What is proposed for the verbs of a section. `profile` None: never assist them. Figures are of today's and of the new."""

    kind: Kind
    profile: Profile | None
    today: Figures
    figures: Figures | None

    @property
    def is_change(self) -> bool:
        """Whether anything differs from today."""
        return self.profile != self.kind.profile


def proposed(kind: Kind, score: Score) -> Proposal:
    """Search for one section; `score` runs the trials of a profile."""
    found = {share: _damped(kind.profile, share) for share in DAMPING_SHARES}
    figures = {share: score(profile) for share, profile in found.items()}
    today = figures[1.0]
    kept = [share for share in DAMPING_SHARES if figures[share].holds]
    if not kept:
        return Proposal(kind, None, today, None)
    least = min(figures[share].cost for share in kept)
    share = min(share for share in kept if figures[share].cost <= least + AS_GOOD)
    chosen, reached = found[share], figures[share]
    for part in CAP_SHARES:
        lower = chosen._replace(cap_unm=max(1, int(chosen.cap_unm * part) // _CAP) * _CAP)
        tried = score(lower)
        if lower.cap_unm < chosen.cap_unm and tried.holds and tried.cost <= reached.cost + AS_GOOD:
            return Proposal(kind, lower, today, tried)
    return Proposal(kind, chosen, today, reached)


def _damped(profile: Profile, share: float) -> Profile:
    """With so much of both dampings, rounded down."""
    return profile._replace(damping=int(profile.damping * share), damping_near=int(profile.damping_near * share))
