"""Where the simulated wearer wants shoulder and elbow: minimum-jerk reaches of the timeline that gaze and hands follow.

A reach begins when the preparation does, as the hands in the picture do; a clear intention goes further. Poses of verbs
are assumed: angles of a seated person at a table, the cup or spoon at the mouth for what is eaten or poured.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, zip_longest

from hilbridge.limits import MS
from hilbridge.verbs import VERBS
from hilbridge.wearer.timeline import DEMO, Event, Timeline

Pair = tuple[float, float]
REST: Pair = (0.2, 0.8)
REACH_S = 0.9
TABLE: Pair = (0.65, 1.05)
POSES: dict[str, Pair] = {
    "Take": (0.85, 0.75),
    "Put": (0.8, 0.8),
    "Transfer": (0.6, 1.9),  # to the mouth
    "Pour": (0.55, 1.4),
    "Inspect/Read": (0.5, 1.7),
    "Open": (0.6, 1.2),
    "Close": (0.6, 1.2),
    "Turn on": (0.9, 0.8),
    "Turn off": (0.9, 0.8),
}
_AGAIN_S = 0.7  # a pause shorter than this is not worth going back to rest
_LOOK_S = 1_200.0  # of a timeline, for a verb


@dataclass(frozen=True, slots=True)
class Leg:
    """From `at_s` on, the joints go to `to`."""

    at_s: float
    to: Pair


class Reaches:
    """Angles, speeds and accelerations of both joints at any time. A leg that is overtaken ends where it then is."""

    def __init__(self, legs: Sequence[Leg]) -> None:
        self._legs = [Leg(-REACH_S, REST), *legs]
        self._starts = [leg.at_s for leg in self._legs]
        self._from = [REST]
        for number, (leg, after) in enumerate(pairwise(self._legs)):
            self._from.append(self._on(number, after.at_s - leg.at_s)[0])

    def __call__(self, t_s: float) -> tuple[Pair, Pair, Pair]:
        """The plan at a time."""
        number = max(0, bisect_right(self._starts, t_s) - 1)
        return self._on(number, t_s - self._starts[number])

    def _on(self, number: int, gone_s: float) -> tuple[Pair, Pair, Pair]:
        begin, end = self._from[number], self._legs[number].to
        one, two = end[0] - begin[0], end[1] - begin[1]
        s = gone_s / REACH_S
        if s >= 1.0:
            return end, (0.0, 0.0), (0.0, 0.0)
        moved = s * s * s * (10.0 + s * (6.0 * s - 15.0))
        rate = 30.0 * s * s * (1.0 + s * (s - 2.0)) / REACH_S
        rises = 60.0 * s * (1.0 + s * (2.0 * s - 3.0)) / REACH_S**2
        return (
            (begin[0] + one * moved, begin[1] + two * moved),
            (one * rate, two * rate),
            (one * rises, two * rises),
        )


def pose(event: Event) -> Pair:
    """Where an action takes both joints: the clearer, the further, as the hands in the picture."""
    goal, extent = POSES.get(VERBS[event.verb], TABLE), 0.4 + 0.6 * event.strength
    return REST[0] + extent * (goal[0] - REST[0]), REST[1] + extent * (goal[1] - REST[1])


def reaches(events: Sequence[Event], from_ns: int = 0) -> Reaches:
    """The plan of these actions; its time 0 is `from_ns`."""
    legs = []
    for event, after in zip_longest(events, events[1:]):
        legs.append(Leg((event.prepare_ns - from_ns) * 1e-9, pose(event)))
        if after is None or (after.prepare_ns - event.end_ns) * 1e-9 > _AGAIN_S:
            legs.append(Leg((event.end_ns - from_ns) * 1e-9, REST))
    return Reaches(legs)


def first_of(seed: int, verb: str) -> Event | None:
    """The first time that the person of this seed does `verb`, within twenty minutes."""
    wanted, last_ns = VERBS.index(verb), round(_LOOK_S * 1_000) * MS
    return next((event for event in Timeline(seed, DEMO).until(last_ns) if event.verb == wanted), None)
