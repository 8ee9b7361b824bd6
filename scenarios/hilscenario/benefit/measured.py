"""What a session on a device came to, in sums that can be added over sessions: help against the plan, harm of wrong ACTs.

Help is measured while the person reaches for or does what the device assists at all (`acting`), spilling while they hold
what can be spilt (`carrying`). Harm is the work of ACTs that were wrong, and how far the hand is from its twin's, which
had a HOLD in place of each of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from firmware_sim.plant.band import filtered
from firmware_sim.plant.parameters import value
from hilbridge.core.gate_figures import GateTick, gate_figures
from hilbridge.limits import MS
from hilbridge.verbs import NEVER_ASSISTED, VERBS
from hilbridge.wearer.timeline import Event
from hilscenario.benefit.gates import Order
from hilscenario.benefit.played import STEP_S, WRONG, Array, Played
from hilscenario.benefit.visits import Visit, plan_of, wearer_of

# On target: the middle of the palm so near to its plan. Where persons 900 to 903 are half of the time, device off.
RADIUS_M = 0.005
CARRYING = frozenset(VERBS.index(verb) for verb in ("Put", "Transfer", "Pour", "Inspect/Read"))
SUMS = (
    "seconds", "acting_s", "carrying_s", "on_target_s", "error_m2s", "tremor_m2s", "shaken_m2_s3", "tilted_rad2s",
    "ticks", "act_ticks", "judged_ticks", "right_ticks", "false_assists", "wrong_s", "wrong_j", "moved_meter_s", "latched",
)  # fmt: skip
PEAKS = ("most_j", "most_moved_m")  # of one wrong ACT, and of any millisecond
Sums = dict[str, float]
_ARM, _HAND = value("upper_arm_length"), value("hand")


@dataclass(frozen=True)
class Wanted:
    """What the plan would have, a value a millisecond: the hand, m, what it needs, m/s2, the forearm's pitch, rad."""

    hand: Array
    acceleration: Array
    pitch: Array
    acting: NDArray[np.bool_]
    carrying: NDArray[np.bool_]


def wanted(visit: Visit) -> Wanted:
    """The plan of a session."""
    plan, count = plan_of(visit), visit.milliseconds
    hand, acceleration, pitch = np.empty((count, 2)), np.empty((count, 2)), np.empty(count)
    for now_ms in range(count):
        (first, elbow), (rate, bends), (rises, bent) = plan((now_ms + 1) * STEP_S)
        both, both_rate, both_rises = first + elbow, rate + bends, rises + bent
        hand[now_ms] = _ARM * sin(first) + _HAND * sin(both), -_ARM * cos(first) - _HAND * cos(both)
        acceleration[now_ms] = (
            _ARM * (cos(first) * rises - sin(first) * rate**2)
            + _HAND * (cos(both) * both_rises - sin(both) * both_rate**2),
            _ARM * (sin(first) * rises + cos(first) * rate**2)
            + _HAND * (sin(both) * both_rises + cos(both) * both_rate**2),
        )
        pitch[now_ms] = both
    return Wanted(hand, acceleration, pitch, *_phases(visit))


def _phases(visit: Visit) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    acting, carrying = np.zeros(visit.milliseconds, bool), np.zeros(visit.milliseconds, bool)
    for event in wearer_of(visit).events(visit.milliseconds * MS):
        if event.verb not in NEVER_ASSISTED:
            acting[_between(event, event.prepare_ns)] = True
        if event.verb in CARRYING:
            carrying[_between(event, event.start_ns)] = True
    return acting, carrying


def _between(event: Event, from_ns: int) -> slice:
    return slice(from_ns // MS, event.end_ns // MS)


def measure(played: Played, twin: Played, asked: Sequence[Order], plan: Wanted) -> Sums:
    """The sums of a session. `twin`: the same without the ACTs that were wrong."""
    beside = played.hand - plan.hand
    error, tremor = np.linalg.norm(beside, axis=1), np.linalg.norm(filtered(beside.T), axis=0)
    shaken = np.zeros_like(played.hand)
    shaken[1:-1] = np.diff(played.hand, 2, axis=0) / STEP_S**2 - plan.acceleration[1:-1]
    moved = np.linalg.norm(played.hand - twin.hand, axis=1)
    is_wrong, given = played.effect == WRONG, np.maximum(played.power, 0.0) * STEP_S
    figures = gate_figures(GateTick(order.verb, order.right) for order in asked)
    return {
        "seconds": len(error) * STEP_S,
        "acting_s": float(plan.acting.sum()) * STEP_S,
        "carrying_s": float(plan.carrying.sum()) * STEP_S,
        "on_target_s": float((error[plan.acting] <= RADIUS_M).sum()) * STEP_S,
        "error_m2s": float((error[plan.acting] ** 2).sum()) * STEP_S,
        "tremor_m2s": float((tremor[plan.acting] ** 2).sum()) * STEP_S,
        "shaken_m2_s3": float((shaken[plan.carrying] ** 2).sum()) * STEP_S,
        "tilted_rad2s": float(((played.pitch - plan.pitch)[plan.carrying] ** 2).sum()) * STEP_S,
        "ticks": figures.ticks,
        "act_ticks": figures.act_ticks,
        "judged_ticks": figures.judged_ticks,
        "right_ticks": figures.right_ticks,
        "false_assists": figures.false_assists,
        "wrong_s": float(is_wrong.sum()) * STEP_S,
        "wrong_j": float(given[is_wrong].sum()),
        "moved_meter_s": float(moved.sum()) * STEP_S,
        "latched": float(played.latched),
        "most_j": _most_of_one(is_wrong, given),
        "most_moved_m": float(moved.max()),
    }


def _most_of_one(is_wrong: NDArray[np.bool_], given: Array) -> float:
    """The most that one wrong ACT gave, however long it was wrong."""
    edges = np.flatnonzero(np.diff(is_wrong.astype(np.int8), prepend=0, append=0))
    return max((float(given[begin:end].sum()) for begin, end in edges.reshape(-1, 2)), default=0.0)


def added(rows: Sequence[Mapping[str, float]]) -> Sums:
    """Sessions together."""
    return {
        **{name: sum(row[name] for row in rows) for name in SUMS},
        **{name: max(row[name] for row in rows) for name in PEAKS},
    }
