"""How long each stage of the way from a picture to its command takes: kept as a histogram, however long a run is."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass

_LEAST_NS = 1_000
_STEPS = 32  # bins to a factor of two: a figure is exact to 2 %
_BINS = 32 * 24  # up to a quarter of a minute


@dataclass(frozen=True, slots=True)
class Stage:
    """One stage's times in milliseconds."""

    name: str
    count: int
    p50_ms: float
    p99_ms: float
    max_ms: float


class Histogram:
    """Times by their size. `add` from one thread at a time."""

    def __init__(self) -> None:
        self.count = self.max_ns = 0
        self._bins = [0] * _BINS

    def add(self, spent_ns: int) -> None:
        """One more."""
        size = math.log2(max(1.0, spent_ns / _LEAST_NS))
        self._bins[min(_BINS - 1, int(size * _STEPS))] += 1
        self.count += 1
        self.max_ns = max(self.max_ns, spent_ns)

    def percentile_ms(self, share: float) -> float:
        """The upper edge of the bin in which it lies, and never above the largest."""
        rank, seen = math.ceil(share * self.count), 0
        for number, count in enumerate(self._bins):
            seen += count
            if count and seen >= rank:
                return min(_LEAST_NS * math.exp2((number + 1) / _STEPS), float(self.max_ns)) / 1e6
        return 0.0

    def shares(self, edges_ms: tuple[float, ...]) -> list[int]:
        """How many lie below each edge and not below the one before; last, how many lie above all."""
        found = [0] * (len(edges_ms) + 1)
        for number, count in enumerate(self._bins):
            middle_ms = _LEAST_NS * math.exp2((number + 0.5) / _STEPS) / 1e6
            found[next((n for n, edge in enumerate(edges_ms) if middle_ms < edge), len(edges_ms))] += count
        return found


class Stages:
    """Stages by name, in the order in which they were first told."""

    def __init__(self) -> None:
        self._stages: dict[str, Histogram] = {}
        self._lock = threading.Lock()

    def add(self, name: str, spent_ns: int) -> None:
        """One more time of a stage, from any thread."""
        with self._lock:
            self._stages.setdefault(name, Histogram()).add(spent_ns)

    def table(self) -> tuple[Stage, ...]:
        """Every stage so far."""
        with self._lock:
            return tuple(
                Stage(name, one.count, one.percentile_ms(0.5), one.percentile_ms(0.99), one.max_ns / 1e6)
                for name, one in self._stages.items()
            )

    def of(self, name: str) -> Histogram | None:
        """One stage, where it was ever told."""
        return self._stages.get(name)
