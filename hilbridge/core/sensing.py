"""Whether sensing has been whole for long enough to act on it: after any gap, trust is earned anew for a fixed time.

The gate's smoothing builds belief up, too, but how fast depends on its settings and on how sure the predictor is. This
time depends on nothing. It runs whatever else forbids ACT, so that no order of faults hides a gap from it. Pure.
"""

from __future__ import annotations

from dataclasses import dataclass

from hilbridge.limits import EARN_NS
from hilbridge.records import HoldReason

# What a sensor or a tick that was away leaves behind it, for a moment: a window to fill, an estimate that is old.
_AFTERMATH = frozenset({HoldReason.WARMING_UP, HoldReason.NO_ESTIMATE, HoldReason.STALE})


@dataclass(frozen=True, slots=True)
class Sensing:
    """`whole_since_ns` is the first tick of unbroken sensing, None in a gap; `broken_by` what the last gap came from,
    and `broken_ns` when that was last so. The default is how a bridge starts: it has seen nothing yet.
    """

    whole_since_ns: int | None = None
    broken_by: HoldReason = HoldReason.WARMING_UP
    broken_ns: int = 0

    def step(self, gap: HoldReason | None, now_ns: int) -> Sensing:
        """One tick; `gap` says why sensing is not whole in it, or None."""
        if gap is not None:
            if gap in _AFTERMATH and self.broken_by not in _AFTERMATH and now_ns - self.broken_ns < EARN_NS:
                return Sensing(None, self.broken_by, self.broken_ns)
            return Sensing(None, gap, now_ns)
        if self.whole_since_ns is None or now_ns < self.whole_since_ns:  # a clock that went back proves nothing
            return Sensing(now_ns, self.broken_by, self.broken_ns)
        return self

    @property
    def is_whole(self) -> bool:
        """Whether there was no gap in the last tick."""
        return self.whole_since_ns is not None

    def objection(self, now_ns: int) -> HoldReason | None:
        """Why ACT may not be asked for: the gap, also while trust is still being earned after it. None when earned."""
        earned = self.whole_since_ns is not None and now_ns - self.whole_since_ns >= EARN_NS
        return None if earned else self.broken_by
