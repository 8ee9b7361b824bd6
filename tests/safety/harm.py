"""What an ACT that nobody meant may do: every verb, 21 behaviours, firm and weak, against the twin without the ACT.

The hand is 0.35 m from the elbow. `work` is what the added torque gives to the arm, at the motor, whatever the arm gives
back; `moved` is how far the hand ever is from where it would be. The controller is the real one, put into ASSIST by hand.
"""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace
from functools import cache

from firmware_sim.device import Device
from firmware_sim.frames import VERB_CODES
from firmware_sim.law.damping import LEASH_UNM_MS
from firmware_sim.law.guidance import GUIDE_UNM
from firmware_sim.memory import ControllerState
from firmware_sim.plant.actuator import Actuator
from firmware_sim.plant.arm import ARM_INERTIA, ARM_WEIGHT_NM, DEVICE_INERTIA, FRICTION
from firmware_sim.plant.wearers import BEHAVIOURS, FIRM_NM_RAD, WEAK_NM_RAD, Wearer, tremor
from firmware_sim.profiles import NONE, Guidance, Profile, profile
from firmware_sim.states import Reason, State
from hilbridge.wire.codec import Codec
from tests.safety.table import Row, Scale

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


def cases(verb: int) -> Iterator[Case]:
    """All of one verb. The longest ACT meets two of the four phases."""
    for behaviour, stiffness, at_ms, for_ms in itertools.product(BEHAVIOURS, STIFFNESS, STARTS_MS, LENGTHS_MS):
        if for_ms < max(LENGTHS_MS) or at_ms in STARTS_MS[1:3]:
            yield Case(verb, behaviour, stiffness, at_ms, for_ms)


def bound_m(profile: Profile) -> float:
    """The furthest that any torque of this profile moves a hand, whatever its wearer does: a proof by superposition.

    The arm with a spring of 2 N m/rad (less what gravity takes off it at 140 degrees) and its damper is linear, so that
    what is added moves it by itself. Slow parts: their largest torque, all in one direction. Damping: the worst impulse
    that the leash allows, I' = torque - I / 0.512 s.
    """
    stiffness = WEAK_NM_RAD + 0.15 * ARM_WEIGHT_NM * math.cos(math.radians(140.0))
    damping = 0.8 * math.sqrt(WEAK_NM_RAD / FIRM_NM_RAD) + FRICTION - 0.08  # follow mode takes 0.08 off
    inertia = ARM_INERTIA + DEVICE_INERTIA
    guided = 0.0 if profile.guidance is Guidance.NEVER else GUIDE_UNM * 1e-6
    pushed_nm = ARM_WEIGHT_NM * profile.gravity_per_mille * 1e-3 + guided
    angle, velocity, step_s = 0.0, 1.0 / inertia, 1e-4
    by_push = by_impulse = 0.0
    for _ in range(100_000):
        by_push += abs(angle) * step_s
        by_impulse += abs(velocity + angle / 0.512) * step_s
        velocity -= (stiffness * angle + damping * velocity) / inertia * step_s
        angle += velocity * step_s
    return HAND_M * (pushed_nm * by_push + LEASH_UNM_MS * 1e-9 * by_impulse)


def _drawn(chance: random.Random) -> dict[str, float]:
    """A wearer that nobody thought of."""
    spread = {
        "at": (20, 120),
        "drift": (-40, 40),
        "size": (0, 30),
        "hertz": (0.1, 3),
        "turn": (0, 6.3),
        "shake": (0, 2),
    }
    spread |= {"shake_hertz": (2, 12), "stiffness": (WEAK_NM_RAD, 8), "act": (1_000, 2_500), "length": (100, 6_000)}
    return {name: chance.uniform(*ends) for name, ends in spread.items()}


def _searched(verb: int, found: dict[str, float]) -> tuple[float, float, bool]:
    """(J, m) of an ACT under a drawn wearer, who drifts, sways and shakes at once; whether it latched and the twin not.

    It ends with a latch: what an arm does that loses follow mode says nothing about torque.
    """
    rate, size, drift = 2.0 * math.pi * found["hertz"], math.radians(found["size"]), math.radians(found["drift"])
    start = math.radians(found["at"])

    def path(t_s: float) -> tuple[float, float]:
        gone = min(t_s, 2.0)
        swing = rate * t_s + found["turn"]
        wanted = start + drift * gone + size * math.sin(swing)
        return wanted, (drift if t_s < 2.0 else 0.0) + size * rate * math.cos(swing)

    wearer = Wearer("drawn", path, tremor(found["shake_hertz"], found["shake"]), stiffness=found["stiffness"])
    twin, device = new_device(wearer), new_device(wearer)
    law, added, work, furthest = device.state.torque, Actuator(), 0.0, 0.0
    begins, ends = int(found["act"]), int(found["act"] + found["length"])
    for now_ms in range(ends + AFTER_MS):
        if now_ms == begins:
            act(device, verb)
        elif now_ms == ends:
            hold(device)
        device.tick((), 0)
        twin.tick((), 0)
        if State.LATCHED in (twin.state.state, device.state.state):
            return work, furthest * HAND_M, twin.state.state is not State.LATCHED
        added.step((law.assist_unm + law.gravity_unm) * 1e-6, _STEP_S)
        work += max(0.0, added.torque_nm * device.arm.velocity) * _STEP_S
        furthest = max(furthest, abs(device.arm.angle - twin.arm.angle))
    return work, furthest * HAND_M, False


def searched(verb: int, tries: int, seed: int) -> tuple[float, float, int]:
    """The worst (J, m) that a climb from drawn wearers comes to, and how often an ACT latched where its twin just did not.

    Half of the tries are new, half near the worst yet.
    """
    chance = random.Random(f"{seed} {verb}")
    worst_j = worst_m = best = 0.0
    latched = 0
    near = _drawn(chance)
    for number in range(tries):
        found = _drawn(chance)
        if number % 2:  # a step from the worst towards somebody else
            found = {name: near[name] + chance.choice((0.0, 0.0, 0.3)) * (found[name] - near[name]) for name in near}
        work_j, moved_m, edge = _searched(verb, found)
        latched += edge
        worst_j, worst_m = max(worst_j, work_j), max(worst_m, moved_m)
        if max(work_j / WORK_LIMIT_J, moved_m / MOVED_LIMIT_M) > best:
            best, near = max(work_j / WORK_LIMIT_J, moved_m / MOVED_LIMIT_M), found
    return worst_j, worst_m, latched


@cache
def names() -> dict[int, str]:
    """Verb codes by the names of the bus."""
    codes = Codec().messages["ACT_CMD"].signals[1].codes
    return {code: name for name, code in (codes or {}).items()}


def _harm_row(verb: int, verbs: str, chosen: list[Case]) -> tuple[Row, list[tuple[Case, Harm]]]:
    done = [(case, harm(case)) for case in chosen]
    bad = sum(h.work_j > WORK_LIMIT_J or h.moved_m > MOVED_LIMIT_M for _, h in done)
    hot, far = max(done, key=lambda each: each[1].work_j), max(done, key=lambda each: each[1].moved_m)
    proved = bound_m(profile(verb))
    figure = (
        f"{bad} of {len(done)} beyond; worst {hot[1].work_j:.3f} J ({_said(hot[0])}), "
        f"{far[1].moved_m * 1e3:.1f} mm ({_said(far[0])}), proved {proved * 1e3:.1f} mm"
    )
    return Row(
        "harm", f"{verbs}: <= 0.1 J, <= 30 mm against the twin", figure, not bad and proved <= MOVED_LIMIT_M
    ), done


def _said(case: Case) -> str:
    return f"{case.behaviour}{', weak' if case.stiffness == WEAK_NM_RAD else ''}, {case.for_ms} ms"


def _tremor_row(verb: int, verbs: str, scale: Scale) -> Row:
    hertz = (3.0, 5.0, 8.0, 12.0) if scale.quick else tuple(half / 2 for half in range(6, 25))
    sizes = (1.0,) if scale.quick else (0.3, 1.0, 2.0)
    worst = {}
    for each in hertz:
        ratios = []
        for size, stiffness in itertools.product(sizes, STIFFNESS[1:] if scale.quick else STIFFNESS):
            wearer = shaking(each, size, stiffness)
            ratios.append(shaken(wearer, each, verb) / _alone(each, size, stiffness))
        worst[each] = max(ratios)
    figure = ", ".join(f"{each:g} Hz {100 * ratio:.1f} %" for each, ratio in worst.items() if each == int(each))
    return Row("harm", f"{verbs}: tremor never above 100 %", figure, max(worst.values()) <= 1.0005)


@cache
def _alone(hertz: float, size_nm: float, stiffness: float) -> float:
    return shaken(shaking(hertz, size_nm, stiffness), hertz, None)


def run(scale: Scale) -> list[Row]:
    """The table per verb; the quick part is a seeded sample."""
    rows, done, shakes, hunts = [], [], [], []
    rng = random.Random(scale.seed)
    for codes in kinds().values():
        verb, verbs = codes[0], ", ".join(names()[code] for code in codes)
        everything = list(cases(verb))
        row, found = _harm_row(verb, verbs, rng.sample(everything, 6) if scale.quick else everything)
        rows.append(row)
        done += found
        shakes.append(_tremor_row(verb, verbs, scale))
        hunts.append(searched(verb, scale.of(300, 2), scale.seed))
    still = [harm(Case(codes[0], each, stiffness, STARTS_MS[0], 2_000)) for codes in kinds().values()
             for each in ("still", "still, level") for stiffness in STIFFNESS]  # fmt: skip
    pushed = sum(found.damping_pushed for _, found in done)
    worst_j, worst_m = max(j for j, _, _ in hunts), max(m for _, m, _ in hunts)
    return [
        *rows,
        *shakes,
        Row(
            "harm",
            "a still arm: assist gives it nothing, support hardly anything",
            f"assist {max(h.assist_j for h in still):.6f} J, with support {max(h.work_j for h in still):.4f} J",
            max(h.assist_j for h in still) < 1e-6 and max(h.work_j for h in still) < 5e-3,
        ),
        Row(
            "harm", "damping never goes along with the velocity, in any tick of all this", f"{pushed} ticks", not pushed
        ),
        Row(
            "harm",
            f"a search for the worst wearer, {scale.of(300, 2)} tries a profile",
            f"worst {worst_j:.3f} J, {worst_m * 1e3:.1f} mm; "
            f"{sum(edge for _, _, edge in hunts)} latched at an edge that the twin just missed",
            worst_j <= WORK_LIMIT_J and worst_m <= MOVED_LIMIT_M,
        ),
    ]
