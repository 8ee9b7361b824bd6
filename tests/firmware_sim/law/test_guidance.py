"""Guidance: only along with the wearer, only after their onset, and small."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import replace

import pytest

from firmware_sim.law import guidance
from firmware_sim.law.filters import track
from firmware_sim.law.memory import Torque
from firmware_sim.profiles import profile

TAKE, OPEN, CUT = profile(1), profile(3), profile(4)


def guided(
    ticks: int, velocity: int, angle: int = 60_000, law: Torque | None = None, used: object = TAKE
) -> list[Torque]:
    law, path = copy(law or Torque()), []
    for _ in range(ticks):
        track(law, velocity, 0)
        guidance.onset(law)
        guidance.guide(law, used, angle, 1000)  # type: ignore[arg-type]  # a profile
        path.append(copy(law))
    return path


@pytest.mark.parametrize("hertz", [3.5, 5.0, 8.0])
def test_h6_tremor_is_no_onset(hertz: float) -> None:
    law = Torque()
    for time_ms in range(4000):
        track(law, round(200_000 * math.sin(2 * math.pi * hertz * time_ms / 1000)), 0)
        guidance.onset(law)
        guidance.guide(law, TAKE, 60_000, 1000)
        assert law.guide_tick == 0


@pytest.mark.parametrize("sign", [1, -1])
def test_h1_guidance_starts_only_after_the_wearers_onset_and_in_its_direction(sign: int) -> None:
    path = guided(700, sign * 10_000)
    first = next(number for number, law in enumerate(path) if law.guide_tick)
    assert 199 <= first <= 350
    assert all(law.guide_unm == 0 for law in path[:first])
    assert path[-1].guide_unm == sign * guidance.GUIDE_UNM
    assert all(0 <= law.guide_unm * sign <= guidance.GUIDE_UNM for law in path)


@pytest.mark.parametrize("velocity", [0, 7_900, -7_900])
def test_h1_guidance_never_starts_without_onset(velocity: int) -> None:
    assert all(law.guide_unm == 0 for law in guided(1500, velocity))


def test_h1_guidance_ends_when_the_wearer_stops_or_turns() -> None:
    law = guided(700, 20_000)[-1]
    assert law.guide_tick > 0
    stopped = guided(500, 0, law=law)
    assert stopped[-1].guide_tick == 0
    assert stopped[-1].guide_unm == 0


def test_guidance_fades_after_the_reach_over_the_ramp_out() -> None:
    law = guided(500, 20_000)[-1]
    path = guided(1200, 20_000, law=law)
    ended = next(number for number, step in enumerate(path) if step.guide_tick == 0)
    fading = [step.fade_ticks for step in path[:ended] if step.fade_ticks]
    assert fading == list(range(1, 201))
    assert path[ended].onset_ticks == 0


def test_guidance_moves_at_its_own_rate_and_scale() -> None:
    law = guided(500, 20_000)[-1]
    for _ in range(10):
        before = law.guide_unm
        guidance.guide(law, TAKE, 60_000, 400)
        assert law.guide_unm == before - guidance.GUIDE_RATE_UNM_PER_MS
    for _ in range(90):
        guidance.guide(law, TAKE, 60_000, 400)
    assert law.guide_unm == guidance.GUIDE_UNM * 400 // 1000


def test_the_reach_ends_at_its_whole_length() -> None:
    law = Torque(guide_tick=900, guide_from_mdeg=60_000, direction=1)
    assert guidance._push(law, TAKE, 94_900) == 100 * guidance.GUIDE_STIFFNESS


def test_near_the_target() -> None:
    law = Torque(guide_tick=1, guide_from_mdeg=60_000, direction=1)
    assert guidance.near_target(law, 95_000)
    assert guidance.near_target(law, 87_001)
    assert not guidance.near_target(law, 87_000)
    assert not guidance.near_target(law, 103_000)
    assert not guidance.near_target(replace(law, guide_tick=0), 95_000)
    assert guidance.near_target(replace(law, direction=-1), 25_000)


@pytest.mark.parametrize("sign", [1, -1])
def test_until_contact_pushes_along_and_lets_go_on_contact(sign: int) -> None:
    moving = guided(600, sign * 20_000, used=OPEN)
    assert moving[-1].guide_unm == sign * guidance.GUIDE_UNM
    touched = guided(800, 0, law=moving[-1], used=OPEN)
    assert touched[-1].guide_unm == 0
    assert touched[-1].guide_tick == 0


def test_never_guided_verbs_are_never_guided() -> None:
    assert all(law.guide_unm == 0 for law in guided(1500, 50_000, used=CUT))
