"""`python -m firmware_sim.tuning.process`: recordings of one wearer in, proposed profiles out; one JSON object each on a line.

In: `profiles` (a file, or null), `control`, `cuff_nm_rad`, `recordings` with `t_s` and `acceleration` (m/s2, rows of three).
Out: `of` (how many trials at most), `tried` as each is done, then `result`; or `error`, a line for people, and exit code 2.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import numpy as np

from firmware_sim.assist_profile import Profile
from firmware_sim.plant.recorded import strongest, torque_of
from firmware_sim.profile_file import NUMBERS, SHIPPED, ProfilesUnusable, kinds_in, read_own
from firmware_sim.tuning.search import MOST_TRIALS, Proposal, proposed
from firmware_sim.tuning.trial import TRIAL_MS, Figures, FollowLatched, Trials, Wearer
from firmware_sim.tuning.written import written


def answer(asked: dict[str, Any], tell: Callable[[dict[str, Any]], None]) -> dict[str, Any]:
    """What is proposed. Raises ProfilesUnusable or FollowLatched."""
    path = SHIPPED if asked["profiles"] is None else Path(asked["profiles"])
    if path != SHIPPED:
        read_own(path)
    kinds = [kind for kind in kinds_in(path) if kind.verbs]
    tremors = tuple(
        strongest(torque_of(np.array(one["t_s"], float), np.array(one["acceleration"], float)), TRIAL_MS)
        for one in asked["recordings"]
    )
    trials = Trials(Wearer(asked["control"], asked["cuff_nm_rad"], tremors))
    tell({"of": MOST_TRIALS * len(kinds)})
    proposals = []
    for kind in kinds:
        left = MOST_TRIALS

        def score(profile: Profile, name: str = kind.name) -> Figures:
            nonlocal left
            found = trials.figures(profile)
            left -= 1
            tell({"tried": name})
            return found

        proposals.append(proposed(kind, score))
        for _ in range(left):
            tell({"tried": kind.name})
    made = written(path.read_text(encoding="utf-8-sig"), path.name, proposals)
    return {
        "profiles": [_said(one) for one in proposals],
        "old_text": made.old_text,
        "new_text": made.new_text,
        "old_hash": made.old_hash,
        "new_hash": made.new_hash,
    }


def _said(one: Proposal) -> dict[str, Any]:
    return {
        "profile": one.kind.name,
        "verbs": list(one.kind.verbs),
        "old": _numbers(one.kind.profile),
        "new": None if one.profile is None else _numbers(one.profile),
        "old_figures": one.today._asdict() | {"holds": one.today.holds},
        "new_figures": None if one.figures is None else one.figures._asdict() | {"holds": one.figures.holds},
    }


def _numbers(profile: Profile) -> dict[str, int]:
    """In the file's keys and units."""
    return {key: int(getattr(profile, number.field)) // number.scale for key, number in NUMBERS.items()}


def main(source: IO[str], out: IO[str]) -> int:
    """Read one request and answer it."""

    def tell(what: dict[str, Any]) -> None:
        out.write(json.dumps(what) + "\n")
        out.flush()

    try:
        tell({"result": answer(json.load(source), tell)})
    except (ProfilesUnusable, FollowLatched) as error:
        tell({"error": str(error)})
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.stdin, sys.stdout))
