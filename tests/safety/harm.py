"""What an ACT that nobody meant may do: every verb, 21 behaviours, firm and weak, against the twin without the ACT.

The hand is 0.35 m from the elbow. `work` is what the added torque gives to the arm, at the motor, whatever the arm gives
back; `moved` is how far the hand ever is from where it would be. The controller is the real one, put into ASSIST by hand.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace
from functools import cache

from firmware_sim.device import Device
from firmware_sim.frames import VERB_CODES
from firmware_sim.memory import ControllerState
from firmware_sim.plant.actuator import Actuator
from firmware_sim.plant.wearers import BEHAVIOURS, FIRM_NM_RAD, WEAK_NM_RAD, Wearer, tremor
from firmware_sim.profiles import NONE, Profile, profile
from firmware_sim.states import Reason, State

HAND_M = 0.35
WORK_LIMIT_J = 0.1
MOVED_LIMIT_M = 0.03
LENGTHS_MS = (240, 2_000, 10_000)
STARTS_MS = (1_000, 1_400, 1_650, 2_600)
AFTER_MS = 1_500
STIFFNESS = (FIRM_NM_RAD, WEAK_NM_RAD)
_STEP_S = 0.001


@dataclass(frozen=True)
class Case:
    """One ACT under one wearer."""

    verb: int
    behaviour: str
    stiffness: float
    at_ms: int
    for_ms: int


@dataclass(frozen=True)
class Harm:
    """What it did. `assist_j` is of damping and guidance alone, `work_j` of gravity support too."""

    work_j: float
    assist_j: float
    moved_m: float
    damping_pushed: int  # ticks in which the damping torque went along with the velocity


def kinds() -> dict[Profile, list[int]]:
    """The verbs that are assisted, by profile: verbs of one profile do the same."""
    found: dict[Profile, list[int]] = {}
    for code in sorted(VERB_CODES):
        if profile(code) != NONE:
            found.setdefault(profile(code), []).append(code)
    return found


def wearer_of(behaviour: str, stiffness: float) -> Wearer:
    """A behaviour of the table, by a wearer so stiff."""
    return replace(BEHAVIOURS[behaviour], stiffness=stiffness)


def new_device(wearer: Wearer) -> Device:
    """At its wearer's first place, in FOLLOW, before anything was asked of it."""
    device = Device(ControllerState(b"k" * 16, 1), wearer)
    device.arm.angle = wearer.path(0.0)[0]
    return device


def cloned(device: Device) -> Device:
    """The same moment, to go on from in another way."""
    twin = copy(device)
    twin.state, twin.arm, twin.actuator = copy(device.state), copy(device.arm), copy(device.actuator)
    twin._inputs = copy(device._inputs)
    return twin


@cache
def without(behaviour: str, stiffness: float, until_ms: int) -> tuple[list[float], dict[int, Device]]:
    """(angles of the twin that is left alone, the device at each start)."""
    device, angles, moments = new_device(wearer_of(behaviour, stiffness)), [], {}
    for now_ms in range(until_ms):
        if now_ms in STARTS_MS:
            moments[now_ms] = cloned(device)
        angles.append(device.arm.angle)
        device.tick((), 0)
    return angles, moments


def act(device: Device, verb: int) -> None:
    """Straight into ASSIST, as an authorised ACT would."""
    state = device.state
    if state.state is State.FOLLOW:
        state.state, state.verb, state.assist_since_ms = State.ASSIST, verb, state.last_tick_ms


def hold(device: Device) -> None:
    """What a HOLD does."""
    if device.state.state is State.ASSIST:
        device.state.state, device.state.reason, device.state.ramp_fault = State.RAMP_DOWN, Reason.HOLD, False


def harm(case: Case) -> Harm:
    """Run one case to 1.5 s after its end."""
    angles, moments = without(case.behaviour, case.stiffness, max(STARTS_MS) + max(LENGTHS_MS) + AFTER_MS + 1)
    device = cloned(moments[case.at_ms])
    law, arm = device.state.torque, device.arm
    added, assist = Actuator(), Actuator()
    work = assist_work = furthest = 0.0
    pushed = 0
    act(device, case.verb)
    for tick in range(case.for_ms + AFTER_MS):
        if tick == case.for_ms:
            hold(device)
        velocity = round(math.degrees(arm.velocity * 1000.0))
        device.tick((), 0)
        pushed += law.damping_unm * velocity > 0
        added.step((law.assist_unm + law.gravity_unm) * 1e-6, _STEP_S)
        assist.step(law.assist_unm * 1e-6, _STEP_S)
        work += max(0.0, added.torque_nm * arm.velocity) * _STEP_S
        assist_work += max(0.0, assist.torque_nm * arm.velocity) * _STEP_S
        furthest = max(furthest, abs(arm.angle - angles[case.at_ms + tick + 1]))
    return Harm(work, assist_work, furthest * HAND_M, pushed)


def shaken(wearer: Wearer, hertz: float, verb: int | None) -> float:
    """Amplitude in rad at the tremor's frequency over the third and fourth second of an ACT; None: without."""
    device, low, high = new_device(wearer), 0.0, 0.0
    for now_ms in range(5_000):
        if now_ms == 1_000 and verb is not None:
            act(device, verb)
        device.tick((), 0)
        if now_ms >= 3_000:
            turn = 2.0 * math.pi * hertz * now_ms * _STEP_S
            low += device.arm.angle * math.sin(turn)
            high += device.arm.angle * math.cos(turn)
    return math.hypot(low, high) / 1_000


def shaking(hertz: float, size_nm: float, stiffness: float) -> Wearer:
    """Tremor at 50 degrees."""
    still = BEHAVIOURS["slow tremor"]
    return replace(still, torque=tremor(hertz, size_nm), stiffness=stiffness)


def cases(verbs: list[int]) -> Iterator[Case]:
    """All of them."""
    for verb in verbs:
        for behaviour in BEHAVIOURS:
            for stiffness in STIFFNESS:
                for at_ms in STARTS_MS:
                    for for_ms in LENGTHS_MS:
                        yield Case(verb, behaviour, stiffness, at_ms, for_ms)
