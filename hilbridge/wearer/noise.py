"""White noise as a pure function of time: any moment may be asked for, in any order, and gives the same numbers.

SplitMix64 is a counter put through a mixer, so the moment itself can be the counter; making one of numpy's generators anew
for every sample takes four to nine times as long.
"""

from __future__ import annotations

import math

import numpy as np

_MASK = (1 << 64) - 1
_GOLDEN = 0x9E3779B97F4A7C15  # 2^64 over the golden ratio: the counter's stride
_PAIRS_PER_NS = 8  # so many of a moment's counters no other moment shares
_UNIT = 2.0**-32


class Noise:
    """One stream of one person's noise."""

    def __init__(self, seed: int, stream: int) -> None:
        self._start = int(np.random.SeedSequence([seed, stream]).generate_state(1, np.uint64)[0])

    def normals(self, t_ns: int, pairs: int) -> list[float]:
        """2 * `pairs` independent standard normals of the moment `t_ns`; at most 8 pairs."""
        made = []
        counter = max(0, t_ns) * _PAIRS_PER_NS
        for number in range(counter + 1, counter + 1 + pairs):
            bits = _mixed(self._start + number * _GOLDEN & _MASK)
            # Box and Muller: a radius and an angle make two. The half keeps the logarithm's argument above zero.
            radius = math.sqrt(-2.0 * math.log(((bits >> 32) + 0.5) * _UNIT))
            angle = (2.0 * math.pi * _UNIT) * (bits & 0xFFFFFFFF)
            made += [radius * math.cos(angle), radius * math.sin(angle)]
        return made


def _mixed(bits: int) -> int:
    bits = (bits ^ bits >> 30) * 0xBF58476D1CE4E5B9 & _MASK
    bits = (bits ^ bits >> 27) * 0x94D049BB133111EB & _MASK
    return bits ^ bits >> 31
