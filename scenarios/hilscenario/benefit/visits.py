"""Who comes to be assisted, and when: persons of a kind of tremor, each with sessions of their own.

A session is a seed of the timeline: what is done, and how it looks. The tremor's frequency and size are the person's.
Camera, gaze and hands see it as large as it swings the hand; arm and eyes shake alike, not in phase.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi

from firmware_sim.plant.chain import wearers_arm
from firmware_sim.plant.nerves import CONTROLS, Person
from firmware_sim.plant.parameters import value
from firmware_sim.plant.tremors import KINDS
from firmware_sim.plant.tremors import Shaking as Tremor
from hilbridge.limits import MS
from hilbridge.wearer.person import Wearer
from hilbridge.wearer.shaking import realistic
from hilbridge.wearer.timeline import DEMO
from hilscenario.twins.reaching import Reaches, reaches
from hilscenario.world.sensing import HEIGHT_PX, WIDTH_PX

# Cerebellar tremor comes with ataxia; whoever wears a device for essential tremor is taken to be weak.
CONTROL_OF = {"cerebellar": "ataxic", "essential": "weak"}
MOST_SESSIONS = 100  # of a person, so that no two have one seed
FIRST_SEED = 30_000  # nobody whom the bundle that ships was trained, calibrated or certified on
_PICTURE_M = 0.6  # what the head camera's picture is wide where the hands are; assumed


@dataclass(frozen=True)
class Visit:
    """One session of one person."""

    person: int
    session: int
    seconds: float = 60.0

    @property
    def kind(self) -> str:
        """Of tremor: persons take turns."""
        return tuple(CONTROL_OF)[self.person % len(CONTROL_OF)]

    @property
    def control(self) -> str:
        """How the person moves."""
        return CONTROL_OF[self.kind]

    @property
    def seed(self) -> int:
        """Of the session."""
        return FIRST_SEED + MOST_SESSIONS * self.person + self.session

    @property
    def milliseconds(self) -> int:
        """How long it lasts."""
        return round(1_000 * self.seconds)


def visits(people: int, sessions: int, seconds: float, first: int = 0) -> list[Visit]:
    """Every session of every person."""
    return [Visit(person, session, seconds) for person in range(first, first + people) for session in range(sessions)]


def tremor_of(visit: Visit) -> Tremor:
    """What shakes the arm: the session's own course of the person's own tremor."""
    shaking = Tremor(KINDS[visit.kind], visit.seed)
    own = Tremor(KINDS[visit.kind], FIRST_SEED + MOST_SESSIONS * visit.person)
    shaking.hertz, shaking.size_nm = own.hertz, own.size_nm
    return shaking


def wearer_of(visit: Visit) -> Wearer:
    """What camera, gaze and hand detector see."""
    own = tremor_of(visit)
    swing_m = value("hand") * own.size_nm / (wearers_arm().about_elbow * (2.0 * pi * own.hertz) ** 2)
    seen = realistic(own.hertz, swing_m / _PICTURE_M)
    if visit.control != "ataxic":
        seen = replace(seen, overshoot=0.0)
    return Wearer(visit.seed, difficulty=DEMO, tremor=seen, width_px=WIDTH_PX, height_px=HEIGHT_PX)


def plan_of(visit: Visit) -> Reaches:
    """Where the person wants both joints: what the same timeline makes of it."""
    return reaches(wearer_of(visit).events(visit.milliseconds * MS))


def person_of(visit: Visit) -> Person:
    """Nerves and muscles at the beginning of the session."""
    return Person(plan_of(visit), CONTROLS[visit.control], tremor_of(visit))
