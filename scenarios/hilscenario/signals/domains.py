"""What values each signal can have, and the nearest valid name for one that is none."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import hilbridge.bus.quick_can  # noqa: F401  # first: cantools would load python-can with all that MF4 needs
from hilbridge.records import HoldReason
from hilbridge.verbs import VERBS
from hilbridge.wire.codec import Codec

NO_VERB = "None"
# Reasons of a bridge that does not run, beside those that a running one gives.
ABSENT_REASONS = ("hung", "stalled", "dead", "silent")


@dataclass(frozen=True, slots=True)
class Words:
    """A signal whose values are words, spelt as recordings and the DBC spell them."""

    values: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Truths:
    """A signal that is true or false; as a number 1 or 0."""


@dataclass(frozen=True, slots=True)
class Numbers:
    """A signal whose values are numbers within limits that no run can leave."""

    low: float = -math.inf
    high: float = math.inf


Domain = Words | Truths | Numbers
Domains = Mapping[str, Domain]


def value_table(message: str, signal: str) -> Mapping[int, str]:
    """A value table of the shipped DBC: code -> name."""
    layout = Codec().messages[message]
    signals = (*layout.signals, layout.multiplexer)
    names = next(one.names for one in signals if one is not None and one.name == signal)
    assert names is not None
    return names


def _status_words(signal: str) -> Words:
    return Words(tuple(name for _, name in sorted(value_table("CTRL_STATUS", signal).items())))


_AGE_MS = Numbers(0.0)
_VERB = Words((NO_VERB, *VERBS))
_ALWAYS_THERE: dict[str, Domain] = {
    "bridge.armed": Truths(),
    "bridge.sensing_age_ms": Numbers(),
    "bridge.sensors_well": Truths(),
    "device.act_age_ms": _AGE_MS,
    "device.angle_deg": Numbers(),
    "device.armed": Truths(),
    "device.assist_nm": Numbers(),
    "device.assist_rise_nm_s": Numbers(0.0),
    "device.assist_zero": Truths(),
    "device.gravity_nm": Numbers(),
    "device.hold_age_ms": _AGE_MS,
    "device.reason": _status_words("Reason"),
    "device.state": _status_words("State"),
    "device.stop_age_ms": _AGE_MS,
    "device.trips": Numbers(0.0),
    "device.velocity_deg_s": Numbers(),
    "gate.act": Truths(),
    "gate.confidence": Numbers(0.0, 1.0),
    "gate.reason": Words((*(str(reason) for reason in HoldReason), *ABSENT_REASONS)),
    "gate.right": Truths(),
    "gate.verb": _VERB,
    "wearer.intended": _VERB,
}


# Only where somebody knows what the wearer wants.
OF_THE_MIND = frozenset({"gate.right", "wearer.intended"})


def domains_of(faults: Iterable[str]) -> dict[str, Domain]:
    """Every signal of a scenario that injects these faults."""
    return {**_ALWAYS_THERE, **{f"fault.{fault}": Truths() for fault in faults}, "fault.any": Truths()}
