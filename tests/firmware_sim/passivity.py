"""Passivity on the worn arm: what an adversary who holds the key makes the assist give to it, against the law's tank.

The adversary may order what they like in every millisecond and sees the arm move. What pushes (guidance, gravity support)
is counted where it gives, never where it takes back; `net` is all that an ACT adds, damping among it, both ways.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass

from firmware_sim.law.allowance import WORK, WORK_BACK_PER_MS
from firmware_sim.plant.drive import Drive
from firmware_sim.plant.nerves import CONTROLS, Person
from firmware_sim.plant.tremors import KINDS, Shaking
from firmware_sim.profiles import NONE, profile
from firmware_sim.states import State
from firmware_sim.worn_device import WornDevice
from hilbridge.verbs import VERBS
from hilscenario.benefit.gates import Order
from hilscenario.benefit.played import Ordered
from hilscenario.twins.reaching import POSES, REST, TABLE, Leg, Reaches

UNIT_J = (1 << 20) * 1e-6 * 17.453293e-6 * 1e-3  # of the law's count of work
TANK_J, REFILL_W = WORK * UNIT_J, WORK_BACK_PER_MS * UNIT_J * 1e3
# What the law's whole numbers lose: less than a unit a tick for each of the two parts that push.
ROUNDED_W = 2.0 * UNIT_J * 1e3
SEQUENCES_OF_A_LIFE = 20
_READY_MS = 400
_VERBS = [index for index in range(len(VERBS)) if profile(index + 1) != NONE]
# (ms of the sequence, speed of the device's elbow in rad/s) -> a verb to ACT for, or None to HOLD
Tactic = Callable[[int, float], int | None]


@dataclass(frozen=True)
class Attack:
    """One sequence. Against `allowed_j`: what the tank held at its start, and was filled by meanwhile."""

    tactic: str
    allowed_j: float
    push_j: float
    net_j: float  # the most that it ever was since the start of the sequence
    spent_j: float  # of the tank at the end, as the law counts
    latched: bool


def _tactics(chance: random.Random) -> tuple[str, Tactic]:
    verb, other = chance.choice(_VERBS), chance.choice(_VERBS)
    on, off = (round(10.0 ** chance.uniform(0.0, 2.7)) for _ in range(2))
    every, up = chance.choice((1, 2, 5, 10, 40)), chance.choice((-1.0, 1.0))
    name = chance.choice(("alternating", "shuffled", "pumping", "with the movement", "steady", "noise"))
    tactics: dict[str, Tactic] = {
        "alternating": lambda at, speed: (verb, other)[at // every % 2],
        "shuffled": lambda at, speed: chance.choice(_VERBS) if at % every == 0 else None,
        "pumping": lambda at, speed: verb if at % (on + off) < on else None,
        "with the movement": lambda at, speed: verb if up * speed > 0.0 else None,
        "steady": lambda at, speed: verb,
        "noise": lambda at, speed: chance.choice((None, verb, other)),
    }
    return name, tactics[name]


def _wearer(chance: random.Random) -> Person:
    legs, at_s = [], 0.3
    while at_s < 60.0:
        legs.append(Leg(at_s, chance.choice((REST, TABLE, *POSES.values()))))
        at_s += chance.uniform(0.6, 3.0)
    kind = chance.choice(("none", *KINDS))
    tremor = None if kind == "none" else Shaking(KINDS[kind], chance.getrandbits(32))
    return Person(Reaches(legs), CONTROLS[chance.choice(tuple(CONTROLS))], tremor)


class Life:
    """One wearer under one sequence after the other: the tank is as the last one left it."""

    def __init__(self, seed: int) -> None:
        self._chance = random.Random(f"passivity {seed}")
        self._device = WornDevice(_wearer(self._chance))
        self._ordered = Ordered(self._device.state)
        self._pushing, self._adding = Drive(self._device.drive.preset), Drive(self._device.drive.preset)
        for at_ms in range(_READY_MS):
            self._tick(Order(at_ms, None, None))

    def sequence(self, milliseconds: int) -> Attack:
        """The next one."""
        name, tactic = _tactics(self._chance)
        device, law = self._device, self._device.state.torque
        allowed_j, push_j, net_j, most_j, latched = (WORK - law.work) * UNIT_J, 0.0, 0.0, 0.0, False
        for at_ms in range(milliseconds):
            verb, before = tactic(at_ms, device.arm.device_speed[1]), law.work
            push_w, net_w = self._tick(Order(at_ms, verb, None))
            if device.state.state is not State.ASSIST:
                allowed_j += min(before, WORK_BACK_PER_MS) * UNIT_J
            latched = latched or device.state.state is State.LATCHED
            push_j, net_j = push_j + push_w * 1e-3, net_j + net_w * 1e-3
            most_j = max(most_j, net_j)
        return Attack(name, allowed_j, push_j, most_j, law.work * UNIT_J, latched)

    def _tick(self, order: Order) -> tuple[float, float]:
        """Power of what pushes, where it gives, and of all that is added; behind the drive, at the joint, W."""
        device, law = self._device, self._device.state.torque
        self._ordered.tell(order, device.ticks + 1)
        device.tick()
        speed = device.arm.device_speed[1]
        push_nm = self._pushing.step((law.guide_unm + law.gravity_unm) * 1e-6, 1e-3)
        added_nm = self._adding.step((law.assist_unm + law.gravity_unm) * 1e-6, 1e-3)
        return max(0.0, push_nm * speed), added_nm * speed


def attacks(first: int, count: int, milliseconds: int = 1_000) -> list[Attack]:
    """So many sequences, of as many lives as they take."""
    made: list[Attack] = []
    for seed in range(first, first + -(-count // SEQUENCES_OF_A_LIFE)):
        life = Life(seed)
        made += [life.sequence(milliseconds) for _ in range(min(SEQUENCES_OF_A_LIFE, count - len(made)))]
    return made


def told(made: list[Attack], milliseconds: int = 1_000) -> list[str]:
    """The worst of each tactic, and of all."""
    lines = [f"tank {1e3 * TANK_J:.1f} mJ, filled by {1e3 * REFILL_W:.1f} mJ/s outside of ASSIST"]
    for name in (*sorted({one.tactic for one in made}), "all"):
        of = [one for one in made if name in (one.tactic, "all")]
        lines.append(
            f"{name}: {len(of)} sequences, pushed at most {1e3 * max(one.push_j for one in of):.1f} mJ, "
            f"net at most {1e3 * max(one.net_j for one in of):.1f} mJ, "
            f"nearest to its tank {1e3 * min(one.allowed_j - one.push_j for one in of):.2f} mJ left, "
            f"tank spent at most {1e3 * max(one.spent_j for one in of):.1f} mJ, "
            f"{sum(exceeds(one, milliseconds) for one in of)} beyond it, {sum(one.latched for one in of)} latched"
        )
    return lines


def exceeds(attack: Attack, milliseconds: int = 1_000) -> bool:
    """Whether more was given than the tank had."""
    allowed_j = attack.allowed_j + ROUNDED_W * milliseconds * 1e-3
    return max(attack.push_j, attack.net_j) > allowed_j
