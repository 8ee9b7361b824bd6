"""Sequences of the twin run, taken down once: what goes in at every tick, and a hash of all numbers after it.

The reference runs once for all mutants of the C; each is then driven at the speed of C. Two states that differ have one hash
in 2^61.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from typing import Any

from firmware_sim.c.flat import flat
from firmware_sim.controller import advance
from firmware_sim.memory import Inputs
from firmware_sim.watchdogs import Limits
from tests.safety.hand import KEY
from tests.safety.tools.c.twin import Twin, sequence_of


@dataclass(slots=True)
class Trace:
    """One sequence. `steps`: inputs, their time, and the numbers that the state was set to before, where it was."""

    nonce: int
    limits: Limits
    steps: list[tuple[Inputs, int, tuple[int, ...] | None]] = field(default_factory=list)
    hashes: list[int] = field(default_factory=list)


class _Taken(Twin):
    """The reference alone, and what it is given."""

    def __init__(self, rng: random.Random) -> None:
        super().__init__(rng)
        self.trace = Trace(self.state.boot_nonce, self.state.limits)
        self.set_to: tuple[int, ...] | None = None

    def _changed(self) -> None:
        self.set_to = flat(self.state)

    def _both(self, inputs: Inputs) -> None:
        advance(self.state, inputs, self.now_ms)
        self.trace.steps.append((inputs, self.now_ms, self.set_to))
        self.trace.hashes.append(hash(self.flattener(self.state)))
        self.set_to = None


def taken(sequences: int, seed: int) -> list[Trace]:
    """So many sequences, the long one last."""
    found = []
    for number in range(sequences, 0, -1):
        twin, ticks = sequence_of(_Taken, seed, number % sequences)
        twin.go(ticks)
        found.append(twin.trace)
    return found


def is_other(controller: Any, traces: list[Trace]) -> bool:
    """Whether a class of controllers differs from the reference anywhere in them."""
    for trace in traces:
        c = controller(KEY, trace.nonce, trace.limits)
        for (inputs, now_ms, set_to), expected in zip(trace.steps, trace.hashes, strict=True):
            if set_to is not None:
                c.load(set_to)
            c.advance(inputs, now_ms)
            if hash(c.dump()) != expected:
                return True
    return False
