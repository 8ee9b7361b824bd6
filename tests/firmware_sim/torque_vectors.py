"""Vectors for a port of the torque law: segments of the world, and what the law must have come to at the end of each.

`python -m tests.firmware_sim.torque_vectors` writes torque_vectors.csv anew; that is a change of the law, to be looked
at.
A segment changes angle, velocity and the wearer's torque linearly, tick by tick, so a port in any language can replay
the file; a triangular wave of velocity comes on top where there is one. Stories begin at rest; the checksum covers every
field of the law's memory in every tick of a segment, so one unit in one tick is enough to be seen. That the law keeps
the contract's limits is for the tests of its parts.
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
from firmware_sim.law.filters import track
from firmware_sim.law.memory import WINDOW_SLOTS, Torque
from firmware_sim.law.numbers import div
from firmware_sim.law.support import support_gone, support_less
from firmware_sim.profiles import profile

_NAMES = [field.name for field in fields(Torque)]
_BEFORE_PEAKS = attrgetter(*_NAMES[: _NAMES.index("peaks")])
# The fields in their order, the peaks of the window one by one, then follow torque.
_LAYOUT = struct.Struct(f"<{len(_NAMES) + WINDOW_SLOTS}q")
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
    wave_ms: int = 0
    wave_mdeg_s: int = 0


class Expected(NamedTuple):
    """At the end of a segment; `crc32` runs over all ticks."""

    assist_unm: int
    gravity_unm: int
    follow_unm: int
    crc32: int


def triangle(number: int, wave_ms: int, size: int) -> int:
    """From -size to size and back in `wave_ms` ticks; division rounds towards zero."""
    if not wave_ms:
        return 0
    phase = 4 * (number % wave_ms)
    return div(size * (phase - wave_ms if phase < 2 * wave_ms else 3 * wave_ms - phase), wave_ms)


def tick(law: Torque, segment: Segment, number: int) -> int:
    """Take the law through tick `number` of a segment; returns follow torque."""
    angle = segment.angle_mdeg + number * segment.angle_step
    velocity = segment.velocity_mdeg_s + number * segment.velocity_step
    velocity += triangle(number, segment.wave_ms, segment.wave_mdeg_s)
    track(law, velocity, segment.user_unm + number * segment.user_step)
    if segment.mode == "assist":
        torque.assisting(law, profile(segment.verb), angle, velocity)
    elif segment.mode == "ramp":
        torque.letting_go(law, velocity)
    elif segment.mode == "stop":
        torque.ramping(law, torque.STOP_STRIDE, velocity)
        support_gone(law)
    elif segment.mode == "fade":
        support_less(law)
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
        story += 1  # pushing until contact: just not slow enough, just slow enough, away again while the push fades
        yield Segment(story, "assist", 3, 600, 60_000, 0, sign * 20_000, 0, 0, 0)
        for speed, ticks in ((3_001, 1_200), (3_000, 900), (2_999, 300), (20_000, 600), (0, 290), (20_000, 600)):
            yield Segment(story, "assist", 3, ticks, 60_000, 0, sign * speed, 0, 0, 0)
        story += 1  # work spent to the last, by support and by guidance, and got back
        yield Segment(story, "assist", 10, 3_000, 60_000, sign * 9, 0, 0, 0, 0)
        yield Segment(story, "assist", 10, 2_500, 60_000, 0, sign * 60_000, 0, 0, 0)
        yield Segment(story, "ramp", 10, 900, 60_000, 0, 0, 0, 0, 0)
        yield Segment(story, "assist", 3, 4_000, 60_000, 0, sign * 60_000, 0, 0, 0)
        yield Segment(story, "ramp", 3, 3_000, 60_000, 0, 0, 0, 0, 0)
    yield from _shaking(story)
    story += 100
    for mode, ticks in (("ramp", 39), ("ramp", 40), ("ramp", 600), ("stop", 9), ("stop", 12), ("rest", 3)):
        story += 1
        yield Segment(story, "assist", 1, 1_500, 70_000, 0, -90_000, 0, 0, 0)
        yield Segment(story, mode, 1, ticks, 70_000, 0, -20_000, 0, 0, 0)
        yield Segment(story, "assist", 1, 1_500, 70_000, 0, -90_000, 0, 0, 0)
        story += 1  # the same out of a tremor, at several places of its wave
        yield Segment(story, "assist", 4, 1_500, 70_000, 0, 0, 0, 0, 0, 100, 30_000)
        for more in (1, 7, 13, 19, 25):
            yield Segment(story, "assist", 4, 300 + more, 70_000, 0, 0, 0, 0, 0, 100, 30_000)
            yield Segment(story, mode, 4, ticks, 70_000, 0, 0, 0, 0, 0, 100, 40_000 - 2_000 * more)


def _shaking(story: int) -> Iterator[Segment]:
    """Tremor of every speed and size, alone, upon a movement, and stopping; half waves just short enough, just too long."""
    for verb in _VERBS:
        for wave_ms in (80, 160, 248, 252, 284, 290, 358, 364, 500):
            story += 1
            for size, speed in ((1_000, 0), (20_000, 0), (120_000, 0), (60_000, 20_000), (60_000, -60_000)):
                yield Segment(story, "assist", verb, 3 * wave_ms + 7, 60_000, 0, speed, 0, 0, 0, wave_ms, size)
            yield Segment(story, "assist", verb, 400, 60_000, 0, 0, 0, 0, 0)
            yield Segment(story, "ramp", verb, 30, 60_000, 0, 0, 0, 0, 0, wave_ms, 20_000)
            yield Segment(story, "assist", verb, 500, 60_000, 0, 0, 0, 0, 0, wave_ms, 20_000)
            yield Segment(story, "stop", verb, 12, 60_000, 0, 0, 0, 0, 0, wave_ms, 9_000)


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
                chance.choice((0, 0, 60, 125, 200, 300)),
                chance.choice((1_000, 10_000, 60_000, 200_000)),
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
