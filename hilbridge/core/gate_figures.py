"""What a run of the gate came to: acts, holds, coverage, precision, false assists. Each has its one definition here."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from typing import NamedTuple


class GateTick(NamedTuple):
    """One tick. `verb` is the assisted one, None under HOLD; `right` is None under HOLD and where the truth is unknown."""

    verb: Hashable
    right: bool | None


@dataclass(frozen=True, slots=True)
class GateFigures:
    """Counts over consecutive ticks. An episode is a run of ticks that assist one verb, or that all hold.

    ticks, act_ticks: all, and those under ACT. acts, holds: episodes of ACT, and of HOLD (the one a run begins in counts).
    judged_ticks: ticks under ACT whose truth is known; right_ticks: those of them whose verb is the wearer's.
    false_assists: episodes of ACT whose first tick is wrong.
    """

    ticks: int
    act_ticks: int
    acts: int
    holds: int
    judged_ticks: int
    right_ticks: int
    false_assists: int

    @property
    def coverage(self) -> float:
        """Share of ticks under ACT; 0 without any tick."""
        return self.act_ticks / self.ticks if self.ticks else 0.0

    @property
    def act_only_precision(self) -> float | None:
        """Share of judged ticks that are right (the paper's act-only precision); None without any."""
        return self.right_ticks / self.judged_ticks if self.judged_ticks else None

    def false_assists_per_min(self, seconds: float) -> float:
        """False assists a minute of a run of that length."""
        return self.false_assists * 60.0 / seconds if seconds > 0.0 else 0.0


def gate_figures(ticks: Iterable[GateTick]) -> GateFigures:
    """Fold ticks in their order."""
    count = act_ticks = acts = holds = judged = right = false = 0
    before: Hashable = object()  # no verb, and no hold
    for tick in ticks:
        count += 1
        begins = tick.verb != before
        before = tick.verb
        if tick.verb is None:
            holds += begins
            continue
        act_ticks += 1
        acts += begins
        judged += tick.right is not None
        right += tick.right is True
        false += begins and tick.right is False
    return GateFigures(count, act_ticks, acts, holds, judged, right, false)
