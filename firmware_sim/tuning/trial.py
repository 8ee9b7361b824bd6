"""One wearer's recorded tremor under one profile, on the worn arm: what helps and what harms, as numbers.

Three trials of four seconds: a cup held (what is left of the tremor), a reach without tremor (how far it is bent), and an ACT
that nobody meant in mid reach of a weak wearer who shakes (what it does to the hand). Each is against the same in FOLLOW. The
real controller runs, put into ASSIST by hand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import degrees, hypot, sqrt
from typing import NamedTuple

from firmware_sim.assist_profile import NONE, Profile, Profiles
from firmware_sim.plant.band import speed_power
from firmware_sim.plant.chain import Pair
from firmware_sim.plant.drive import Drive
from firmware_sim.plant.nerves import CONTROLS, Person, Plan
from firmware_sim.plant.parameters import PRESETS
from firmware_sim.plant.tremors import Recorded
from firmware_sim.states import Reason, State
from firmware_sim.worn_device import WornDevice

TRIAL_MS = 4_000
_ACT_MS, _JUDGED_MS = 800, 1_000
_FALSE_MS = (1_450, 2_900)  # from the middle of the reach on, to the way back
_OUT_S, _BACK_S, _REACH_S = 1.0, 2.6, 0.9
_REST: Pair = (0.2, 0.8)
_CUP: Pair = (0.55, 1.4)  # held before the chest
_STEP_S = 0.001
_VERB = 1  # of a trial, which knows no other
_WEAK = CONTROLS["weak"]

WORK_LIMIT_J, HAND_LIMIT_MM = 0.1, 30.0  # what a wrong ACT may do (docs/decisions/109)
DISTORTED_LIMIT_DEG = 1.5
LEFT_LIMIT = 1.02  # tremor is not to grow; 2 % are what support does by moving the arm to another angle


class FollowLatched(ValueError):
    """The device latches with this wearer before it assists, so nothing can be said; the message is one line."""


class Figures(NamedTuple):
    """What one profile comes to. `left`: power of the tremor over that in FOLLOW. Work and hand: the worst false ACT."""

    left: float
    distorted_deg: float
    work_j: float
    hand_mm: float
    latched: bool = False

    @property
    def holds(self) -> bool:
        """Whether every bar is kept."""
        return (
            not self.latched
            and self.left <= LEFT_LIMIT
            and self.distorted_deg <= DISTORTED_LIMIT_DEG
            and self.work_j <= WORK_LIMIT_J
            and self.hand_mm <= HAND_LIMIT_MM
        )

    @property
    def cost(self) -> float:
        """What the search makes small: tremor left, and distortion as a share of its bar."""
        return self.left + self.distorted_deg / DISTORTED_LIMIT_DEG


@dataclass(frozen=True)
class Wearer:
    """Who is tuned for: how they move, the cuff, and the tremor of each recording as elbow torque, 1000 a second."""

    control: str
    cuff_nm_rad: float | None
    tremors_nm: tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Trace:
    """One trial, a value a millisecond: angle of the arm's elbow, hand in m, speed at the device, torque that was added."""

    elbow: list[float]
    hand: list[Pair]
    speed: list[float]
    added_nm: list[float]
    latched: bool


def held(t_s: float) -> tuple[Pair, Pair, Pair]:
    """A plan: the cup stays where it is."""
    del t_s
    return _CUP, (0.0, 0.0), (0.0, 0.0)


def reaching(t_s: float) -> tuple[Pair, Pair, Pair]:
    """A plan: from rest to the cup and back, minimum jerk."""
    there, begin, end = t_s < _BACK_S, _REST, _CUP
    if not there:
        begin, end = _CUP, _REST
    s = min(max((t_s - (_OUT_S if there else _BACK_S)) / _REACH_S, 0.0), 1.0)
    moved = s * s * s * (10.0 + s * (6.0 * s - 15.0))
    rate = 30.0 * s * s * (1.0 + s * (s - 2.0)) / _REACH_S
    rises = 60.0 * s * (1.0 + s * (2.0 * s - 3.0)) / _REACH_S**2
    one, two = end[0] - begin[0], end[1] - begin[1]
    return (begin[0] + one * moved, begin[1] + two * moved), (one * rate, two * rate), (one * rises, two * rises)


@dataclass
class Trials:
    """The trials of one wearer. What happens in FOLLOW is the same for every profile and run once."""

    wearer: Wearer
    _following: dict[tuple[object, ...], Trace] = field(default_factory=dict)

    def figures(self, profile: Profile) -> Figures:
        """Run all trials of a profile. Raises FollowLatched."""
        left, follow = 0.0, 0.0
        harm: list[tuple[float, float]] = []
        latched = False
        for tremor in self.wearer.tremors_nm:
            pair = self._pair(held, False, tremor, profile, (_ACT_MS, TRIAL_MS))
            follow += speed_power(pair[0].elbow[_JUDGED_MS:])
            left += speed_power(pair[1].elbow[_JUDGED_MS:])
            wrong = self._pair(reaching, True, tremor, profile, _FALSE_MS)
            harm.append(_harm(*wrong))
            latched = latched or pair[1].latched or wrong[1].latched
        calm = self._pair(reaching, False, (), profile, (_ACT_MS, TRIAL_MS))
        apart = [degrees(here - there) for there, here in zip(*(one.elbow[_JUDGED_MS:] for one in calm), strict=True)]
        return Figures(
            left / follow if follow > 0.0 else 1.0,
            sqrt(sum(one * one for one in apart) / len(apart)),
            max(work for work, _ in harm),
            max(moved for _, moved in harm),
            latched or calm[1].latched,
        )

    def _pair(
        self, plan: Plan, weak: bool, tremor: tuple[float, ...], profile: Profile, act_ms: tuple[int, int]
    ) -> tuple[Trace, Trace]:
        """The trial in FOLLOW and with the ACT."""
        key = (plan, weak, tremor)
        if key not in self._following:
            self._following[key] = self._run(plan, weak, tremor, None)
            if self._following[key].latched:
                raise FollowLatched(
                    "the simulated device latches with this tremor before it assists, it is too strong or the cuff too soft; "
                    "leave that recording out, or give a stiffer --cuff"
                )
        return self._following[key], self._run(plan, weak, tremor, (profile, act_ms))

    def _run(
        self, plan: Plan, weak: bool, tremor: tuple[float, ...], act: tuple[Profile, tuple[int, int]] | None
    ) -> Trace:
        control = _WEAK if weak else CONTROLS[self.wearer.control]
        preset = PRESETS["quasi-direct"]
        profiles = Profiles((NONE, NONE if act is None else act[0]), "")
        person = Person(plan, control, Recorded(tremor) if tremor else None)
        device = WornDevice(person, preset, self.wearer.cuff_nm_rad, profiles)
        state, law, arm, added = device.state, device.state.torque, device.arm, Drive(preset)
        made, latched = Trace([], [], [], [], latched=False), False
        for now_ms in range(TRIAL_MS):
            if act is not None:
                _tell(device, act[1], now_ms)
            device.tick()
            latched = latched or state.state is State.LATCHED
            made.elbow.append(arm.angle[1])
            made.hand.append(arm.hand())
            made.speed.append(arm.device_speed[1])
            made.added_nm.append(added.step((law.assist_unm + law.gravity_unm) * 1e-6, _STEP_S))
        return Trace(made.elbow, made.hand, made.speed, made.added_nm, latched)


def _tell(device: WornDevice, act_ms: tuple[int, int], now_ms: int) -> None:
    """Into ASSIST and out of it, as an authorised ACT and a HOLD would."""
    state = device.state
    if now_ms == act_ms[0] and state.state is State.FOLLOW:
        state.state, state.verb, state.assist_since_ms = State.ASSIST, _VERB, state.last_tick_ms
    elif now_ms == act_ms[1] and state.state is State.ASSIST:
        state.state, state.ramp_fault, state.reason = State.RAMP_DOWN, False, Reason.HOLD


def _harm(follow: Trace, act: Trace) -> tuple[float, float]:
    """Work in J that the added torque gave, whatever it took back elsewhere; mm that the hand was ever off."""
    work = sum(max(0.0, torque * speed) * _STEP_S for torque, speed in zip(act.added_nm, act.speed, strict=True))
    off = max(hypot(x - a, y - b) for (x, y), (a, b) in zip(act.hand, follow.hand, strict=True))
    return work, 1e3 * off


Score = Callable[[Profile], Figures]
