"""Memory of the torque law as no movement would leave it just now: at an edge, or one beside what it was.

What a law decides at such places no sequence of an arm comes to in reasonable time; both controllers must agree on it all the
same.
"""

from __future__ import annotations

import random

from firmware_sim.law.guidance import NEAR_MDEG, REACH_MDEG, REACH_TICKS
from firmware_sim.law.memory import Torque
from firmware_sim.law.numbers import REACHED
from firmware_sim.memory import Inputs
from firmware_sim.profiles import profile

# What is scrambled, and between which bounds both sides hold it.
_SCRAMBLED = {
    **dict.fromkeys(("slow_mean", "second_mean"), (-300_000 << 10, 300_000 << 10)),
    **dict.fromkeys(("user_mean",), (-40_000_000 << 5, 40_000_000 << 5)),
    **dict.fromkeys(("fast_mdeg_s",), (-300_000, 300_000)),
    **dict.fromkeys(("wave_peak", "last_peak", "before_peak"), (0, 300_000)),
    **dict.fromkeys(("wave_ticks", "last_ticks", "before_ticks"), (1, 1_000)),
    **dict.fromkeys(("onset_ticks", "guide_tick", "contact_ticks", "fade_ticks"), (0, 950)),
    **dict.fromkeys(("assist_ticks", "ramp_tick"), (0, 40)),
    **dict.fromkeys(("gravity_tick",), (0, 500)),
    **dict.fromkeys(("direction", "wave_up"), (-1, 1)),
    **dict.fromkeys(("authority",), (0, 1_000)),
    **dict.fromkeys(("gain_most",), (0, 5_000)),
    **dict.fromkeys(("impulse",), (-15_000_000, 15_000_000)),
    **dict.fromkeys(("work",), (0, 4_400_000)),
    **dict.fromkeys(("guide_unm", "guide_from_unm"), (-50_000, 50_000)),
    **dict.fromkeys(("damping_unm", "damping_from_unm"), (-2_500_000, 2_500_000)),
    **dict.fromkeys(("gravity_unm", "gravity_from_unm", "gravity_top_unm"), (0, 1_000_000)),
    **dict.fromkeys(("guide_from_mdeg",), (-30_000, 190_000)),
}  # fmt: skip
_SPEEDS_MDEG_S = (-2, -1, 0, 1, 2, 3_000, -3_000, 8_000, -8_000)


def scramble(rng: random.Random, torque: Torque, read: Inputs, verb: int) -> None:
    """Change the memory before a tick with these readings, and sometimes their velocity."""
    if rng.random() < 0.3:
        read.velocity_mdeg_s = rng.choice(_SPEEDS_MDEG_S)
    if rng.random() < 0.3:
        _lowest_in_one_place(rng, torque)
    if rng.random() < 0.3:
        _tremor(rng, torque, read, verb)
    if rng.random() < 0.3:
        _guided(rng, torque, read)
    for name in rng.sample(tuple(_SCRAMBLED), rng.choice((0, 1, 2, 6))):
        least, most = _SCRAMBLED[name]
        was = int(getattr(torque, name))
        near = rng.choice((least, most, 0, 1, 2, -1, was + 1, was - 1, -was, was // 2, round(most / 3)))
        if name == "slow_mean" and rng.random() < 0.5:  # what is above it is all but nothing
            near = (read.velocity_mdeg_s + rng.choice((-2, -1, 0, 1, 2))) << 10
        value = max(least, min(most, near))
        setattr(torque, name, value > 0 if name == "wave_up" else value)


def _lowest_in_one_place(rng: random.Random, torque: Torque) -> None:
    """Of the last 250 ms' assist, one slot is the least."""
    peaks = [rng.choice((900_000, 1_000_000, 1_500_000)) for _ in torque.peaks]
    peaks[rng.choice((0, 1, 2, rng.randrange(len(peaks))))] = rng.choice((0, 1, 100_000))
    torque.peaks = tuple(peaks)


def _tremor(rng: random.Random, torque: Torque, read: Inputs, verb: int) -> None:
    """A strong one, in half waves as long as the profile damps, and full damping against it."""
    half = profile(verb).half_wave_ms
    ticks = [max(1, rng.choice((40, 40, half - 1, half, half + 1))) for _ in range(3)]
    torque.wave_ticks, torque.last_ticks, torque.before_ticks = ticks
    torque.last_peak = torque.before_peak = torque.gain_most = 300_000
    way = rng.choice((1, -1))
    torque.impulse = rng.choice((0, 2_000_000)) * way
    read.velocity_mdeg_s = way * rng.choice((20_000, 25_000))
    torque.damping_unm = -way * rng.choice((895_000, 950_000, 1_100_000))


def _guided(rng: random.Random, torque: Torque, read: Inputs) -> None:
    """On a guided reach, close to where it should be now, or to its end."""
    torque.direction = rng.choice((1, -1))
    torque.guide_tick = rng.choice((1, rng.randrange(1, REACH_TICKS), REACH_TICKS - 1, REACH_TICKS, REACH_TICKS + 1))
    reached = REACHED[min(torque.guide_tick * 100 // REACH_TICKS, 100)]
    ahead = torque.direction * REACH_MDEG * reached // 1000 + rng.randrange(-600, 600)
    at_its_end = torque.direction * REACH_MDEG - rng.choice((1, -1)) * (NEAR_MDEG + rng.choice((-1, 0, 1)))
    torque.guide_from_mdeg = read.angle_mdeg - rng.choice((ahead, at_its_end))
    slow = torque.direction * rng.choice((3_000, 8_000, 20_000))
    if rng.random() < 0.7:
        torque.slow_mean, read.velocity_mdeg_s = slow << 10, slow
