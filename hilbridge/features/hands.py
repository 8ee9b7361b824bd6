"""Hands: two tracks that keep their identity (paper, "up to two hand tracks with velocities").

Detections carry no identity worth trusting (handedness flips between APIs), so they are matched to tracks by position
so that the distances' sum is least. Each track is a constant-velocity Kalman filter. It coasts briefly through missed
detections, then it is gone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations

from hilbridge.features.kalman import ConstantVelocityFilter
from hilbridge.features.layout import MAX_HANDS
from hilbridge.limits import HAND_COAST_NS, SENSING_LIMIT_NS
from hilbridge.records import Hand, HandTracks

MEASUREMENT_SD = 0.012  # of the picture: MediaPipe's palm centre scatters by about 1 %
VELOCITY_VARIANCE = 0.5  # of a hand just found, picture widths per second squared
ACCELERATION_SD_PER_S2 = 3.0  # reaching peaks at a few picture widths per second squared
MATCH_DISTANCE = 0.35  # further than a hand moves in one step: another hand
MIN_SCORE = 0.3
SAME_HAND = 0.05  # of the picture: two palm centres so near are one hand found twice
# A detector that sees more hands than this in one picture is not to be believed, nor to be waited for.
MAX_CANDIDATES = 8
Pairs = tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class HandState:
    """One tracked hand: palm centre in 0..1 of the picture, velocity per second."""

    x: float
    y: float
    vx: float
    vy: float


class _Track:
    def __init__(self, hand: Hand, captured_ns: int) -> None:
        self.point = ConstantVelocityFilter(
            hand.x, hand.y, ACCELERATION_SD_PER_S2, MEASUREMENT_SD**2, VELOCITY_VARIANCE
        )
        self.stepped_ns = captured_ns
        self.seen_ns = captured_ns

    def predict(self, now_ns: int) -> None:
        if now_ns > self.stepped_ns:
            self.point.predict(now_ns - self.stepped_ns)
            self.stepped_ns = now_ns

    def update(self, hand: Hand, captured_ns: int) -> None:
        self.point.update(hand.x, hand.y)
        self.seen_ns = captured_ns

    def distance(self, hand: Hand) -> float:
        return math.hypot(hand.x - self.point.x, hand.y - self.point.y)

    def state(self) -> HandState:
        point = self.point
        return HandState(point.x, point.y, point.vx, point.vy)


class HandTracker:
    """Two track slots. A new hand takes the slot of its half of the picture (0 left, 1 right), or the free one."""

    def __init__(self) -> None:
        self._slots: list[_Track | None] = [None] * MAX_HANDS
        self._seen_ns: int | None = None

    def reset(self) -> None:
        """Forget all tracks."""
        self.__init__()  # type: ignore[misc]

    def update(self, tracks: HandTracks | None, now_ns: int) -> tuple[HandState | None, ...] | None:
        """Advance to `now_ns` with the newest detections (the same ones again or None: nothing new).

        Returns one entry per slot, or None when the hand detector itself is silent or stale (modality invalid).
        """
        fresh = (
            tracks is not None
            and tracks.captured_ns != self._seen_ns
            and now_ns - tracks.captured_ns <= SENSING_LIMIT_NS
        )
        if fresh and tracks is not None:
            self._seen_ns = tracks.captured_ns
        if self._seen_ns is None or now_ns - self._seen_ns > SENSING_LIMIT_NS:
            self.reset()
            return None
        for track in self._slots:
            if track is not None:
                track.predict(now_ns)
        if fresh and tracks is not None:
            self._associate(_apart([hand for hand in tracks.hands if _usable(hand)]), now_ns)
        for slot, track in enumerate(self._slots):
            if track is not None and now_ns - track.seen_ns > HAND_COAST_NS:
                self._slots[slot] = None
        return tuple(None if track is None else track.state() for track in self._slots)

    def _associate(self, hands: list[Hand], now_ns: int) -> None:
        if len(hands) > MAX_CANDIDATES:
            hands = sorted(hands, key=lambda hand: -hand.score)[:MAX_CANDIDATES]
        tracks = [track for track in self._slots if track is not None]
        distance = [[track.distance(hand) for hand in hands] for track in tracks]
        unmatched = set(range(len(hands)))
        for row, column in nearest(distance):
            if distance[row][column] <= MATCH_DISTANCE:
                tracks[row].update(hands[column], now_ns)
                unmatched.discard(column)
        # The most certain detections get what is free; a third hand is somebody else's.
        for index in sorted(unmatched, key=lambda i: -hands[i].score):
            free = [slot for slot, track in enumerate(self._slots) if track is None]
            if free:
                preferred = 0 if hands[index].x < 0.5 else 1
                self._slots[preferred if preferred in free else free[0]] = _Track(hands[index], now_ns)


def nearest(distance: Sequence[Sequence[float]]) -> Pairs:
    """The pairs (row, column) whose distances' sum is least: as many as there can be; of equal sums the first.

    Every way is tried, since there are two rows at most: the Hungarian method would take longer to set up.
    """
    ways = _ways(len(distance), len(distance[0]) if distance else 0)
    return min(ways, key=lambda way: sum([distance[row][column] for row, column in way]))


@lru_cache(maxsize=64)
def _ways(rows: int, columns: int) -> list[Pairs]:
    if rows > columns:
        return [tuple(zip(chosen, range(columns), strict=True)) for chosen in permutations(range(rows), columns)]
    return [tuple(enumerate(chosen)) for chosen in permutations(range(columns), rows)]


def _apart(hands: list[Hand]) -> list[Hand]:
    """The hands without those that the detector found twice: of two in one place the more certain stays."""
    kept: list[int] = []
    for index in sorted(range(len(hands)), key=lambda one: -hands[one].score):
        hand = hands[index]
        if all(math.hypot(hand.x - hands[other].x, hand.y - hands[other].y) > SAME_HAND for other in kept):
            kept.append(index)
    return [hands[index] for index in sorted(kept)]


def _usable(hand: Hand) -> bool:
    return (
        math.isfinite(hand.x)
        and math.isfinite(hand.y)
        and -0.5 <= hand.x <= 1.5
        and -0.5 <= hand.y <= 1.5
        and hand.score >= MIN_SCORE
    )
