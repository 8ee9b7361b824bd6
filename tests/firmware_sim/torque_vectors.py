"""Vectors for a port of the torque law: segments of the world, and what the law must have come to at the end of each.

`python -m tests.firmware_sim.torque_vectors` writes torque_vectors.csv anew; that is a change of the law, to be looked
at. A segment changes angle, velocity and the wearer's torque linearly, tick by tick, so a port in any language can
replay the file. Stories begin at rest; the checksum covers every field of the law's memory in every tick of a segment,
so one unit in one tick is enough to be seen. That the law keeps the contract's limits is for test_torque.py.
"""

from __future__ import annotations

import csv
import random
import struct
import zlib
from collections.abc import Iterator
from dataclasses import fields
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from firmware_sim import torque
from firmware_sim.profiles import NONE, profile
from firmware_sim.torque import Torque

_LAYOUT = struct.Struct("<43q")  # the fields in their order, the peaks of the window one by one, then follow torque
_BEFORE_PEAKS = attrgetter(*[field.name for field in fields(Torque)][:16])
FILE = Path(__file__).with_suffix(".csv")
MODES = ("assist", "ramp", "stop", "fade", "rest", "follow")
_VERBS = (1, 3, 4, 6, 10, 14, 15)  # one of each profile


class Segment(NamedTuple):
    """`ticks` ms in one mode: values at its first tick and what each tick adds."""

    story: int
    mode: str
    verb: int
    ticks: int
    angle_mdeg: int
    angle_step: int
    velocity_mdeg_s: int
    velocity_step: int
    user_unm: int
    user_step: int


class Expected(NamedTuple):
    """At the end of a segment; `crc32` runs over all ticks."""

    assist_unm: int
    gravity_unm: int
    follow_unm: int
    crc32: int


def tick(law: Torque, segment: Segment, number: int) -> int:
    """Take the law through tick `number` of a segment; returns follow torque."""
    angle = segment.angle_mdeg + number * segment.angle_step
    velocity = segment.velocity_mdeg_s + number * segment.velocity_step
    user = segment.user_unm + number * segment.user_step
    used = profile(segment.verb) if segment.mode == "assist" else NONE
    torque.track(law, used, velocity)
    if segment.mode == "assist":
        torque.assisting(law, used, angle, velocity, user)
    elif segment.mode == "ramp":
        torque.letting_go(law)
    elif segment.mode == "stop":
        torque.ramping(law, torque.STOP_STRIDE)
        torque.support_gone(law)
    elif segment.mode == "fade":
        torque.supporting_less(law)
    elif segment.mode == "rest":
        torque.at_rest(law)
    return torque.follow_torque(angle, velocity)


def replayed(segments: list[Segment]) -> Iterator[tuple[Segment, Expected]]:
    """What the law comes to, segment by segment."""
    law, story = Torque(), -1
    for segment in segments:
        if segment.story != story:
            law, story = Torque(), segment.story
        crc, follow = 0, 0
        for number in range(segment.ticks):
            follow = tick(law, segment, number)
            crc = zlib.crc32(_LAYOUT.pack(*_BEFORE_PEAKS(law), *law.peaks, law.slot_tick, follow), crc)
        yield segment, Expected(law.assist_unm, law.gravity_unm, follow, crc)


def read() -> list[tuple[Segment, Expected]]:
    """The committed vectors, in their order."""
    rows = []
    with FILE.open(newline="") as file:
        for row in csv.DictReader(file):
            numbers = {name: value if name == "mode" else int(value) for name, value in row.items()}
            segment = Segment(**{name: numbers[name] for name in Segment._fields})  # type: ignore[arg-type]
            rows.append((segment, Expected(*(int(numbers[name]) for name in Expected._fields))))
    return rows


def _directed() -> Iterator[Segment]:
    """Every threshold of the law met exactly, and missed by one on either side."""
    story = 0
    for verb in _VERBS:
        for speed in (7_999, 8_000, -8_000, 60_000):
            sign = 1 if speed > 0 else -1
            story += 1
            # Long enough to be an onset, then a reach that the arm follows, leads and lags behind.
            yield Segment(story, "assist", verb, 900, 60_000, 0, speed, 0, 0, 0)
            yield Segment(story, "assist", verb, 450, 60_000, sign * 20, speed, 0, 0, 0)
            yield Segment(story, "assist", verb, 300, 60_000 + sign * 9_000, sign * 200, speed, 0, 0, 0)
            yield Segment(story, "assist", verb, 120, 60_000 + sign * 26_900, 0, speed, 0, 0, 0)
            for slow in (3_001, 3_000, 2_999, 0):
                yield Segment(story, "assist", verb, 450, 95_000, 0, sign * slow, 0, 0, 0)
                yield Segment(story, "assist", verb, 300, 95_000, 0, speed, 0, 0, 0)
            yield Segment(story, "assist", verb, 400, 95_000, -sign * 20, -speed, 0, 0, 0)
        for opposing in (499_999, 500_000, 500_001, 1_499_999, 1_500_000, 1_500_001, 4_000_000):
            story += 1
            for pulls in (1, -1):
                yield Segment(story, "assist", verb, 420, 90_000, 0, -pulls * 90_000, 0, 0, 0)
                yield Segment(story, "assist", verb, 60, 90_000, 0, -pulls * 90_000, 0, -pulls * opposing, 0)
                yield Segment(story, "assist", verb, 200, 90_000, 0, -pulls * 90_000, 0, 0, 0)
                yield Segment(story, "assist", verb, 400, 90_000, 0, -pulls * 90_000, 0, pulls * 5_000, -pulls * 5_000)
    for sign in (1, -1):
        story += 1  # a reach at a speed whose damping leaves room to see the push fade
        for angle, step, ticks in ((60_000, sign * 15, 1_300), (60_000 + sign * 19_500, 0, 300)):
            yield Segment(story, "assist", 1, ticks, angle, step, sign * 20_000, 0, 0, 0)
        story += 1  # pushing until contact: just not slow enough, just slow enough, away again while the push fades
        yield Segment(story, "assist", 3, 600, 60_000, 0, sign * 20_000, 0, 0, 0)
        for speed, ticks in ((3_001, 1_200), (3_000, 900), (2_999, 300), (20_000, 600), (0, 290), (20_000, 600)):
            yield Segment(story, "assist", 3, ticks, 60_000, 0, sign * speed, 0, 0, 0)
    for mode, ticks in (("ramp", 39), ("ramp", 40), ("ramp", 600), ("stop", 9), ("stop", 12), ("rest", 3)):
        story += 1
        yield Segment(story, "assist", 1, 1_500, 70_000, 0, -90_000, 0, 0, 0)
        yield Segment(story, mode, 1, ticks, 70_000, 0, -20_000, 0, 0, 0)
        yield Segment(story, "assist", 1, 1_500, 70_000, 0, -90_000, 0, 0, 0)


def _random(seed: int, stories: int) -> Iterator[Segment]:
    """Worlds nobody thought of, drawn from values near the law's thresholds."""
    chance = random.Random(seed)
    speeds = (0, 1, 999, 1_000, 2_999, 3_000, 7_999, 8_000, 20_000, 90_000, 250_000, 399_999)
    angles = (-20_000, -1, 0, 1, 30_000, 45_500, 89_999, 90_000, 90_001, 120_250, 145_000, 180_000, 269_999, 359_999)
    users = (0, 1, 499_999, 500_000, 700_001, 1_499_999, 1_500_000, 3_000_000)
    lengths = (1, 2, 9, 10, 11, 40, 41, 150, 199, 200, 201, 300, 500, 901)
    for story in range(1_000, 1_000 + stories):
        verb = chance.choice(_VERBS)
        for _ in range(chance.randint(4, 10)):
            yield Segment(
                story,
                chance.choices(MODES, (12, 3, 1, 1, 1, 2))[0],
                verb,
                chance.choice(lengths),
                chance.choice(angles),
                chance.choice((0, 0, 1, -1, 37, -60)),
                chance.choice((1, -1)) * chance.choice(speeds),
                chance.choice((0, 0, 0, 1, -1, 25, -25)),
                chance.choice((1, -1)) * chance.choice(users),
                chance.choice((0, 0, 1_000, -1_000)),
            )


def write() -> None:
    """Run the law over all segments and write what it came to."""
    with FILE.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow((*Segment._fields, *Expected._fields))
        for segment, expected in replayed([*_directed(), *_random(3, 40)]):
            writer.writerow((*segment, *expected))


if __name__ == "__main__":
    write()
