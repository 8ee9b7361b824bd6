"""tau_on for one wearer: the lowest that keeps the wished precision, and never below today's nor the certified one. Pure.

Coverage falls as tau_on rises, so the lowest that is precise enough acts most. Precise enough is what the bundle's replayed
curve says from there on, and, where the wearer's recordings are labelled, what the gate replayed on them says.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from hilbridge.intent.bundle import Bundle, Replayed

LEAST_ACTS = 25  # ticks in ACT of one's own, a second of them, below which they say nothing


class Own(NamedTuple):
    """The gate on the wearer's own labelled recordings at one tau_on: ticks in ACT that are judged, those right, all known."""

    acts: int
    right: int
    known: int

    @property
    def precision(self) -> float | None:
        """None where there is too little to say."""
        return self.right / self.acts if self.acts >= LEAST_ACTS else None


@dataclass(frozen=True, slots=True)
class Threshold:
    """Today's tau_on and the proposed one, with what the bundle's curve says of both; `why` it is no lower."""

    today: float
    tau_on: float
    wished: float
    before: Replayed | None
    after: Replayed | None
    own_before: Own | None
    own_after: Own | None
    why: str

    @property
    def is_change(self) -> bool:
        """Whether anything differs from today."""
        return self.tau_on != self.today


def threshold_for(
    bundle: Bundle, today: float, wished: float, own_at: Callable[[float], Own] | None = None
) -> Threshold:
    """What to propose. own_at: the wearer's own replay at a tau_on; None where nothing is labelled."""
    promise = None if bundle.provenance is None or bundle.doubt is not None else bundle.provenance.certificate
    floor = today if promise is None else max(today, promise.tau_on)
    why = "today's" if floor == today else "the certified one"
    enough = bundle.tau_for(wished)
    tau_on = floor if enough is None else max(floor, enough)
    if enough is None:
        why = f"the bundle's replay reaches {wished:g} nowhere; {why} stays"
    elif tau_on > floor:
        why = f"lowest at which the bundle's replay keeps {wished:g}"
    if own_at is not None:
        tau_on, why = _own_way(bundle.curve, tau_on, why, wished, own_at)
    own_before, own_after = (None, None) if own_at is None else (own_at(today), own_at(tau_on))
    before, after = _at(bundle.curve, today), _at(bundle.curve, tau_on)
    return Threshold(today, tau_on, wished, before, after, own_before, own_after, why)


def _own_way(
    curve: Sequence[Replayed], start: float, why: str, wished: float, own_at: Callable[[float], Own]
) -> tuple[float, str]:
    """Upwards from `start` until the wearer's own replay is precise enough, too; where it never is, `start` stays."""
    first = own_at(start).precision
    if first is None or first >= wished:
        return start, why
    for point in curve:
        if point.tau_on > start:
            reached = own_at(point.tau_on).precision
            if reached is None:
                break
            if reached >= wished:
                return point.tau_on, f"lowest at which this wearer's own recordings keep {wished:g}"
    return start, f"{why}; this wearer's own recordings keep {wished:g} nowhere"


def _at(curve: Sequence[Replayed], tau_on: float) -> Replayed | None:
    """The curve's point at a threshold, or the next above; None beyond its end, where the gate never acted."""
    return next((point for point in curve if point.tau_on >= tau_on - 1e-9), None)
