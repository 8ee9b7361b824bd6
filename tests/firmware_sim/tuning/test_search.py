"""The search over profiles: it only ever takes away, whatever the trials say, and prefers less where less is as good."""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim.assist_profile import Profile
from firmware_sim.profile_file import SHIPPED, kinds_in, profiles_of, read, refuse_wider
from firmware_sim.tuning.search import AS_GOOD, CAP_SHARES, DAMPING_SHARES, MOST_TRIALS, proposed
from firmware_sim.tuning.trial import Figures
from firmware_sim.tuning.written import written

REACH = kinds_in()[0]
GOOD = Figures(0.5, 0.3, 0.01, 5.0)


def damping_of(profile: Profile) -> float:
    return profile.damping / REACH.profile.damping


def best_at(share: float, cap_matters: bool = False) -> Callable[[Profile], Figures]:
    def score(profile: Profile) -> Figures:
        worse = abs(damping_of(profile) - share) + (cap_matters and 1.0 - profile.cap_unm / REACH.profile.cap_unm)
        return GOOD._replace(left=0.5 + 0.4 * worse)

    return score


@pytest.mark.parametrize("share", DAMPING_SHARES)
def test_the_share_of_damping_with_the_least_cost(share: float) -> None:
    found = proposed(REACH, best_at(share, cap_matters=True))
    assert found.profile == REACH.profile._replace(damping=int(3000 * share), damping_near=int(5000 * share))
    assert found.today == best_at(share, cap_matters=True)(REACH.profile)
    assert found.figures is not None
    assert found.figures.left == pytest.approx(0.5)
    assert found.is_change == (share != 1.0)


def test_where_two_are_as_good_it_is_the_lesser_and_the_lowest_cap() -> None:
    found = proposed(REACH, lambda profile: GOOD)
    assert found.profile == REACH.profile._replace(damping=0, damping_near=0, cap_unm=200_000)
    within = {share: GOOD._replace(left=0.5 + (AS_GOOD * 0.9 if share < 1.0 else 0.0)) for share in DAMPING_SHARES}
    found = proposed(REACH, lambda profile: within[damping_of(profile)])
    assert found.profile is not None
    assert found.profile.damping == 0
    beyond = {share: GOOD._replace(left=0.5 + (AS_GOOD * 1.1 if share < 1.0 else 0.0)) for share in DAMPING_SHARES}
    found = proposed(REACH, lambda profile: beyond[damping_of(profile)])
    assert found.profile is not None
    assert found.profile.damping == 3000


@pytest.mark.parametrize(("needed", "left"), [(0.05, 0.1), (0.2, 0.25), (0.4, 0.5), (0.9, 1.0)])
def test_the_lowest_cap_that_costs_nothing(needed: float, left: float) -> None:
    def score(profile: Profile) -> Figures:
        enough = profile.cap_unm >= needed * REACH.profile.cap_unm
        return best_at(1.0)(profile)._replace(distorted_deg=0.3 if enough else 0.4)

    found = proposed(REACH, score)
    assert found.profile is not None
    assert found.profile.cap_unm == left * REACH.profile.cap_unm


@pytest.mark.parametrize(
    "bad", [{"left": 1.03}, {"distorted_deg": 1.6}, {"work_j": 0.11}, {"hand_mm": 31.0}, {"latched": True}]
)
def test_h1_what_breaks_a_bar_is_not_proposed_and_where_all_do_it_is_never(bad: dict[str, float]) -> None:
    found = proposed(REACH, lambda profile: GOOD._replace(**(bad if profile.damping else {})))
    assert found.profile is not None
    assert found.profile.damping == 0
    found = proposed(REACH, lambda profile: GOOD._replace(**bad))
    assert (found.profile, found.figures) == (None, None)
    assert found.is_change
    low = proposed(REACH, lambda profile: GOOD._replace(**(bad if profile.cap_unm < 1_500_000 else {})))
    assert low.profile is not None
    assert low.profile.cap_unm == 2_000_000


def test_bars_are_kept_at_their_edge() -> None:
    edge = Figures(1.02, 1.5, 0.1, 30.0)
    assert edge.holds
    assert edge.cost == pytest.approx(2.02)


def test_trials_are_as_many_as_said() -> None:
    asked: list[Profile] = []

    def score(profile: Profile) -> Figures:
        asked.append(profile)
        return best_at(1.0, cap_matters=True)(profile)

    proposed(REACH, score)
    assert len(asked) == MOST_TRIALS == len(DAMPING_SHARES) + len(CAP_SHARES)


@given(st.integers(0, 2**32))
def test_h4_whatever_trials_say_nothing_is_widened(seed: int) -> None:
    def score(profile: Profile) -> Figures:
        chance = random.Random(f"{seed} {profile}")
        drawn = (chance.uniform(0, 1.5), chance.uniform(0, 2.0), chance.uniform(0, 0.14), chance.uniform(0, 40))
        return Figures(*drawn, latched=chance.random() < 0.1)

    proposals = [proposed(kind, score) for kind in kinds_in()]
    made = written(SHIPPED.read_text(encoding="utf-8"), "profiles.toml", proposals)
    after = profiles_of([one.kind._replace(profile=one.profile) for one in proposals if one.profile is not None])
    refuse_wider(after, read(), "profiles.toml")
    assert made.new_hash == f"{after.hash32:08X}"
    for one in proposals:
        for code in range(32):
            assert after.of(code).cap_unm <= read().of(code).cap_unm
        if one.profile is not None:
            today = one.kind.profile
            assert one.profile == today._replace(
                damping=min(one.profile.damping, today.damping),
                damping_near=min(one.profile.damping_near, today.damping_near),
                cap_unm=min(one.profile.cap_unm, today.cap_unm),
            )
            assert one.figures is not None
            assert one.figures.holds
