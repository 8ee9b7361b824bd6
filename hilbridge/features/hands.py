"""Hands: two tracks that keep their identity (paper, "up to two hand tracks with velocities").

Detections carry no identity worth trusting (handedness flips between APIs), so they are matched to tracks by position
with the Hungarian method. Each track is a constant-velocity Kalman filter (filterpy) built here by hand: filterpy's
`kinematic_kf(2, 1)` observes x + y (DESIGN.md). A track coasts briefly through missed detections, then it is gone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from hilbridge.features.layout import MAX_HANDS
from hilbridge.records import Hand, HandTracks

MEASUREMENT_SD = 0.012  # of the picture: MediaPipe's palm centre scatters by about 1 %
ACCELERATION_SD_PER_S2 = 3.0  # reaching peaks at a few picture widths per second squared
MATCH_DISTANCE = 0.35  # further than a hand moves in one step: another hand
MAX_COAST_NS = 160_000_000
MAX_AGE_NS = 150_000_000
MIN_SCORE = 0.3


@dataclass(frozen=True, slots=True)
class HandState:
    """One tracked hand: palm centre in 0..1 of the picture, velocity per second."""

    x: float
    y: float
    vx: float
    vy: float


class _Track:
    def __init__(self, hand: Hand, captured_ns: int) -> None:
        kalman = KalmanFilter(dim_x=4, dim_z=2)
        kalman.x = np.array([[hand.x], [0.0], [hand.y], [0.0]])
        kalman.H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
        kalman.P = np.diag([MEASUREMENT_SD**2, 0.5, MEASUREMENT_SD**2, 0.5])
        kalman.R = np.eye(2) * MEASUREMENT_SD**2
        self.kalman = kalman
        self.stepped_ns = captured_ns
        self.seen_ns = captured_ns

    def predict(self, now_ns: int) -> None:
        dt = max(0, now_ns - self.stepped_ns) * 1e-9
        q = ACCELERATION_SD_PER_S2**2
        pp, pv, vv = q * dt**4 / 4, q * dt**3 / 2, q * dt**2
        self.kalman.predict(
            F=np.array([[1.0, dt, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, dt], [0.0, 0.0, 0.0, 1.0]]),
            Q=np.array([[pp, pv, 0.0, 0.0], [pv, vv, 0.0, 0.0], [0.0, 0.0, pp, pv], [0.0, 0.0, pv, vv]]),
        )
        self.stepped_ns = max(self.stepped_ns, now_ns)

    def update(self, hand: Hand, captured_ns: int) -> None:
        self.kalman.update(np.array([[hand.x], [hand.y]]))
        self.seen_ns = captured_ns

    @property
    def position(self) -> tuple[float, float]:
        return float(self.kalman.x[0, 0]), float(self.kalman.x[2, 0])

    def state(self) -> HandState:
        x, vx, y, vy = (float(number) for number in self.kalman.x[:, 0])
        return HandState(x, y, vx, vy)


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
        fresh = tracks is not None and tracks.captured_ns != self._seen_ns and now_ns - tracks.captured_ns <= MAX_AGE_NS
        if fresh and tracks is not None:
            self._seen_ns = tracks.captured_ns
        if self._seen_ns is None or now_ns - self._seen_ns > MAX_AGE_NS:
            self.reset()
            return None
        for track in self._slots:
            if track is not None:
                track.predict(now_ns)
        if fresh and tracks is not None:
            self._associate([hand for hand in tracks.hands if _usable(hand)], now_ns)
        for slot, track in enumerate(self._slots):
            if track is not None and now_ns - track.seen_ns > MAX_COAST_NS:
                self._slots[slot] = None
        return tuple(None if track is None else track.state() for track in self._slots)

    def _associate(self, hands: list[Hand], now_ns: int) -> None:
        slots = [slot for slot, track in enumerate(self._slots) if track is not None]
        cost = self._distances(slots, hands)
        unmatched = set(range(len(hands)))
        for row, column in zip(*linear_sum_assignment(cost), strict=True):
            track = self._slots[slots[row]]
            if cost[row, column] <= MATCH_DISTANCE and track is not None:
                track.update(hands[column], now_ns)
                unmatched.discard(int(column))
        # The most certain detections get what is free; a third hand is somebody else's.
        for index in sorted(unmatched, key=lambda i: -hands[i].score):
            free = [slot for slot, track in enumerate(self._slots) if track is None]
            if free:
                preferred = 0 if hands[index].x < 0.5 else 1
                self._slots[preferred if preferred in free else free[0]] = _Track(hands[index], now_ns)

    def _distances(self, slots: list[int], hands: list[Hand]) -> NDArray[np.float64]:
        cost = np.zeros((len(slots), len(hands)))
        for row, slot in enumerate(slots):
            track = self._slots[slot]
            assert track is not None
            x, y = track.position
            cost[row] = [math.hypot(hand.x - x, hand.y - y) for hand in hands]
        return cost


def _usable(hand: Hand) -> bool:
    return (
        math.isfinite(hand.x)
        and math.isfinite(hand.y)
        and -0.5 <= hand.x <= 1.5
        and -0.5 <= hand.y <= 1.5
        and hand.score >= MIN_SCORE
    )
