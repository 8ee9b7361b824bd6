"""Figures of the worn arm for docs/arm.md: `python -m tests.tools.arm.figures [PART...] [--count N] [--first N]`.

mujoco: against MuJoCo over 2 s. hold: cuff torque in FOLLOW. tremor: what ACT leaves of tremor, by cuff and loop delay.
wrong: false ACTs and wrong verbs over verbs and wearers. sampled: N more, of any wearer, verb, phase and wrong verb.
passivity: N sequences of an adversary who holds the key. support: N persons assisted with gravity support and without.
speed: how quick it all is.
"""

from __future__ import annotations

import argparse
import itertools
import random
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from math import sqrt
from unittest import mock

import numpy as np

from firmware_sim.plant.band import speed_power
from firmware_sim.plant.nerves import CONTROLS, Person
from firmware_sim.plant.parameters import PRESETS
from firmware_sim.plant.tremors import KINDS, Shaking
from firmware_sim.states import State
from firmware_sim.worn_device import WornDevice
from hilscenario.benefit import page
from hilscenario.benefit.gates import Gate, Order, decided, orders
from hilscenario.benefit.measured import measure, wanted
from hilscenario.benefit.played import play
from hilscenario.benefit.run import Outcome
from hilscenario.benefit.visits import visits, wearer_of
from hilscenario.twins.page import TITLES, worst
from hilscenario.twins.reaching import REST, Leg, Reaches, first_of
from hilscenario.twins.run import Ask, Body, Pair, acted_ms, begins_ms, cases, compare
from tests.firmware_sim import passivity as adversary

POUR = 10
VERBS = ("Take", "Open", "Cut", "Inspect/Read", "Pour", "Mix", "Operate")  # one of each profile
CUFFS = (80.0, 150.0, 300.0, 600.0, 1000.0)
DELAYS_MS = (1, 2, 5, 10)
REACHING = Reaches([Leg(at + part, to) for at in range(1, 60, 4) for part, to in ((0.0, (0.55, 1.4)), (2.0, REST))])
STILL = Reaches([Leg(-5.0, (0.55, 1.4))])


def mujoco() -> None:
    """The largest difference of a joint over 2 s."""
    from tests.firmware_sim.plant.test_worn import CASES, apart

    for driven in (False, True):
        free = max(apart(name, cuff, driven) for name, cuff in CASES if name is None)
        worn = max(apart(name, cuff, driven) for name, cuff in CASES if name is not None)
        print(f"{'driven' if driven else 'falling'}: free arm {free:.3f} deg, arm + cuff + device {worn:.3f} deg")


def hold() -> None:
    """RMS of the cuff's torque at the elbow over 20 s of reaches in FOLLOW, no tremor."""
    for (name, preset), control in itertools.product(PRESETS.items(), CONTROLS):
        device, total = WornDevice(Person(REACHING, CONTROLS[control]), preset), 0.0
        for _ in range(20_000):
            device.tick()
            total += device.arm.cuff_torque()[1] ** 2
        print(f"{name}, {control}: {sqrt(total / 20_000):.3f} N m RMS, {device.state.state.name}")


def _powers(device: WornDevice, act: bool) -> tuple[float, list[float]]:
    """Power of 3 to 12 Hz of the elbow's speed over 4 s; the angles."""
    angles, state = [], device.state
    for now_ms in range(5_000):
        if act and now_ms == 800 and state.state is State.FOLLOW:
            state.state, state.verb, state.assist_since_ms = State.ASSIST, POUR, state.last_tick_ms
        device.tick()
        angles.append(device.arm.angle[1])
    return speed_power(angles[1_000:]), angles


def tremor() -> None:
    """What ACT for Pour leaves of tremor at a held cup, against FOLLOW; the loop's delay is the drive's dead time."""
    for kind, delay in itertools.product(KINDS, DELAYS_MS):
        left = []
        for cuff in CUFFS:
            preset = replace(PRESETS["quasi-direct"], dead_s=(delay - 1) * 0.001)
            pair = []
            for act in (False, True):
                shaking = Shaking(replace(KINDS[kind], resting=1.0), 5)
                pair.append(_powers(WornDevice(Person(STILL, CONTROLS["steady"], shaking), preset, cuff), act)[0])
            left.append(pair[1] / pair[0])
        print(
            f"{kind}, delay {delay} ms: "
            + ", ".join(f"{cuff:g}: {one:.2f}" for cuff, one in zip(CUFFS, left, strict=True))
        )
    for control in CONTROLS:
        both = [_powers(WornDevice(Person(REACHING, CONTROLS[control])), act)[1] for act in (False, True)]
        apart = np.degrees(np.array(both[0]) - np.array(both[1]))[1_000:]
        print(f"voluntary movement, {control}: {np.sqrt(np.mean(apart**2)):.2f} deg RMS")


def wrong() -> None:
    """The worst of false ACTs, wrong verbs, and dropouts while pouring, a wearer at a time."""
    for control, kind in itertools.product(
        ("weak", "ataxic", "steady"), ("cerebellar", "none", "essential", "parkinsonian")
    ):
        rows = [(pair, compare(pair)[0]) for pair in cases(1, Body(control, kind), VERBS)]
        for row in worst(rows):
            told = ", ".join(f"{title} {one}" for title, one in zip(TITLES, row, strict=True))
            print(f"{control}, {kind}: {told}", flush=True)


def speed() -> None:
    """Simulated over processor time, controller in Python."""
    device = WornDevice(Person(REACHING, CONTROLS["steady"], Shaking(KINDS["essential"], 1)))
    began = time.process_time()
    for _ in range(10_000):
        device.tick()
    print(f"{10.0 / (time.process_time() - began):.0f} times real time")


def _sample(chance: random.Random) -> Pair | None:
    """One false ACT or wrong verb, of any wearer, action, phase and length; None where this person never does the verb."""
    verb, seed = chance.choice(VERBS), chance.randrange(1, 60)
    action = first_of(seed, verb)
    if action is None:
        return None
    body = Body(chance.choice(tuple(CONTROLS)), chance.choice(("none", *KINDS)))
    start, end = begins_ms(action), begins_ms(action) + acted_ms(action)
    if chance.random() < 0.5:
        early = chance.randrange(200, end - 240)
        ask = Ask(chance.choice(VERBS), early, min(end + 1_000, early + round(10.0 ** chance.uniform(2.4, 3.7))))
        return Pair("false ACT", verb, seed, body, ask, None, action)
    other = chance.choice([one for one in VERBS if one != verb])
    return Pair("wrong verb", verb, seed, body, Ask(other, start, end), Ask(verb, start, end), action)


def sampled(count: int, first: int) -> None:
    """The worst of a seeded sample, by wearer; sample n is always the same one."""
    drawn = [_sample(random.Random(f"wrong {number}")) for number in range(first, first + count)]
    rows = [(pair, compare(pair)[0]) for pair in drawn if pair is not None]
    for control in CONTROLS:
        for row in worst([one for one in rows if one[0].body.control == control]):
            print(f"{control}: " + ", ".join(f"{title} {one}" for title, one in zip(TITLES, row, strict=True)))
    beyond = [(pair, found) for pair, found in rows if found.work_j > 0.1 or found.hand_mm > 30.0]
    print(f"{len(rows)} of {count} drawn are cases; beyond 0.1 J or 30 mm: {len(beyond)}")
    for pair, found in sorted(beyond, key=lambda one: -one[1].hand_mm)[:5]:
        print(f"  {pair.event}, {pair.verb}, seed {pair.seed}, {pair.body.control}, {pair.body.tremor}: {found}")


def passivity(count: int, first: int) -> None:
    """What the assist gave, by tactic."""
    for line in adversary.told(adversary.attacks(first, count)):
        print(line)


def support(count: int, first: int) -> None:
    """What the calibrated gate's ACTs do to N persons, a session of 40 s each; the same with no gravity support in the law."""
    outcomes = []
    for visit in visits(count, 1, 40.0, first):
        plan, wearer, asked = wanted(visit), wearer_of(visit), {"off": list[Order]()}
        asked["as it is"] = asked["no support"] = orders(decided(visit, Gate("calibrated")), wearer)
        for name, own in asked.items():
            with mock.patch("firmware_sim.torque.support") if name == "no support" else nullcontext():
                played = play(visit, own)
            outcomes.append(Outcome(name, visit, measure(played, played, own, plan)))
    for kind in sorted({one.visit.kind for one in outcomes}):
        sample = page.Sample([one for one in outcomes if one.visit.kind == kind])
        for row in page.table(sample, page.HELP):
            told = (f"{figure.title} {cell}" for figure, cell in zip(page.HELP, row[1:], strict=True))
            print(f"{kind}, {row[0]}: " + ", ".join(told))


PARTS: dict[str, Callable[[], None]] = {
    "mujoco": mujoco,
    "hold": hold,
    "tremor": tremor,
    "wrong": wrong,
    "speed": speed,
}
COUNTED: dict[str, Callable[[int, int], None]] = {"sampled": sampled, "passivity": passivity, "support": support}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", nargs="*", help=f"of {', '.join((*PARTS, *COUNTED))}; default: all")
    parser.add_argument("--count", type=int, default=200, help="samples, sequences")
    parser.add_argument("--first", type=int, default=0, help="the first sample, or the first adversary's life")
    asked = parser.parse_args()
    for part in asked.part or (*PARTS, *COUNTED):
        print(f"-- {part}")
        if part in PARTS:
            PARTS[part]()
        else:
            COUNTED[part](asked.count, asked.first)
