"""What an ACT may still do: authority and work."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import pytest

from firmware_sim import torque
from firmware_sim.law import allowance
from firmware_sim.law.filters import track
from firmware_sim.law.memory import Torque
from firmware_sim.profiles import profile

requirement = pytest.mark.requirement
POUR = profile(10)


@requirement("T9")
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("user", "authority"),
    [
        (0, 1000),
        (-500_000, 1000),
        (-500_001, 999),
        (-1_000_000, 500),
        (-1_499_999, 0),
        (-1_500_000, 0),
        (-3_000_000, 0),
        (3_000_000, 1000),
    ],
)
def test_h1_authority_falls_as_the_wearer_opposes(user: int, authority: int, sign: int) -> None:
    law = Torque(guide_unm=40_000 * sign, user_mean=user * sign * 1024)
    allowance.opposed(law)
    assert law.authority == authority


@requirement("T9")
@pytest.mark.parametrize(("push", "authority"), [(16_384, 0), (8_192, 500), (5_461, 833), (0, 1000)])
def test_h7_a_push_that_is_hardly_there_is_hardly_opposed(push: int, authority: int) -> None:
    law = Torque(gravity_unm=push, user_mean=-2_000_000 * 1024)
    allowance.opposed(law)
    assert law.authority == authority


@requirement("T9")
def test_h1_authority_comes_back_slowly() -> None:
    law, seen = Torque(authority=0), []
    for _ in range(501):
        allowance.opposed(law)
        seen.append(law.authority)
    assert seen[:3] == [2, 4, 6]
    assert seen[-2:] == [1000, 1000]


@requirement("T9")
def test_h1_who_presses_against_support_gets_less_of_it() -> None:
    law, path = Torque(), []
    for time_ms in range(2500):
        track(law, 0, -2_500_000 if time_ms > 900 else 0)
        torque.assisting(law, POUR, 90_000, 0)
        path.append(law.gravity_unm)
    assert path[900] == 80_000
    assert path[-1] < 17_000


@requirement("T9")
def test_h7_authority_does_not_chatter() -> None:
    law, seen = Torque(), []
    for time_ms in range(4000):
        velocity = round(20_000 * math.sin(2 * math.pi * 6.0 * time_ms / 1000))
        # Pressing against whatever the device does in this tick, and down all the time.
        user = -1_000_000 - (1_000_000 if law.assist_unm > 0 else -1_000_000)
        track(law, velocity, user)
        torque.assisting(law, POUR, 90_000, velocity)
        seen.append(law.authority)
    turns = sum((b - a) * (c - b) < 0 for a, b, c in zip(seen[2000:], seen[2001:], seen[2002:], strict=False))
    assert turns < 2 * 12 * 2  # not more often than the tremor turns
    assert max(abs(b - a) for a, b in itertools.pairwise(seen)) <= 20


def test_h5_tremor_of_2_newton_metres_keeps_all_authority() -> None:
    law = Torque()
    for time_ms in range(3000):
        swing = math.sin(2 * math.pi * 5.0 * time_ms / 1000)
        velocity = round(50_000 * swing)
        track(law, velocity, round(2_000_000 * swing))
        torque.assisting(law, POUR, 90_000, velocity)
        assert law.authority == 1000


@pytest.mark.parametrize(
    ("spent", "share"),
    [
        (0, 1000),
        (1_639_000, 1000),
        (1_639_001, 999),
        (1_639_000 + 2_731, 998),
        (3_004_000, 500),
        (4_369_000, 0),
        (5_000_000, 0),
    ],
)
def test_h4_the_last_part_of_the_work_fades(spent: int, share: int) -> None:
    assert allowance.work_left(Torque(work=spent)) == share


def test_work_is_of_every_part_that_pushes_and_of_no_damping() -> None:
    law = Torque(gravity_unm=80_000, guide_unm=-50_000, damping_unm=-900_000, work=7)
    allowance.spend(law, 60_000)
    assert law.work == 7 + (80_000 * 60_000 >> 20)
    allowance.spend(law, -60_000)
    assert law.work == 7 + (80_000 * 60_000 >> 20) + (50_000 * 60_000 >> 20)
    before = replace(law)
    allowance.spend(law, 0)
    assert law == before


def test_work_is_80_millijoules() -> None:
    assert allowance.WORK * 2**20 * 1e-6 * math.radians(1e-3) * 1e-3 == pytest.approx(0.08, rel=1e-3)


def test_h4_a_sway_ends_support_when_its_work_is_spent() -> None:
    law, joules = Torque(), 0.0
    for time_ms in range(10_000):
        velocity = round(90_000 * math.sin(2 * math.pi * time_ms / 1000))
        track(law, velocity, 0)
        torque.assisting(law, POUR, 90_000, velocity)
        joules += max(0.0, law.gravity_unm * 1e-6 * math.radians(velocity * 1e-3)) * 1e-3
    assert 0.07 < joules <= 0.0802
    assert law.gravity_unm < 3_000


def test_recovery_stops_at_nothing_spent() -> None:
    law = Torque(work=438)
    allowance.recover(law)
    assert law.work == 1
    allowance.recover(law)
    assert law.work == 0
