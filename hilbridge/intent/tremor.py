"""The tremor guard: confidence must not survive an involuntary oscillation of the hands.

Under tremor the network sees hands that reach and withdraw several times a second and can be confident about nothing.
The guard looks at the tracked hand positions themselves: band-passed from 3 to 11.5 Hz, the median magnitude over the
last 1.28 s. A median, because reaching is a brief broadband movement that must not count as tremor. At 25 Hz nothing
above 12.5 Hz can be seen; tremor of 12 Hz beats with the sampling and passes unseen, which docs/learning.md says.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import deque

from hilbridge.features.layout import HANDS, MAX_HANDS
from hilbridge.records import FeatureVector

# scipy.signal.butter(2, [3.0, 11.5], btype="band", fs=25, output="sos"): written out, as intent needs no scipy.
SECTIONS = (
    (0.4808384292640905, -0.961676858528181, 0.4808384292640905, 1.0, -0.9593878879281492, 0.35835169557701924),
    (1.0, 2.0, 1.0, 1.0, 1.6454265073056196, 0.7041256659214957),
)
WINDOW_STEPS = 32
MEDIAN_TO_SD = 1.4826  # of a Gaussian; for a sine the figure is a little above its standard deviation
ON = 0.006  # picture widths; calm hands stay below in 96 % of steps, a tremor of 0.02 is above in 95 %
OFF = 0.005
STRONGER = (
    0.012,
    0.024,
)  # where the second and third level of tremor begin; each ends at the same share below as the first


class TremorGuard:
    """One wearer's guard. `update` once per 25 Hz step."""

    def __init__(self, on: float = ON, off: float = OFF) -> None:
        if not 0.0 < off <= on:
            raise ValueError(f"tremor thresholds on {on}, off {off}: need 0 < off <= on")
        self._on, self._off = on, off
        self.reset()

    def reset(self) -> None:
        """Forget the hands."""
        self._channels = [_Channel() for _ in range(2 * MAX_HANDS)]
        self._steps = 0
        self.level = 0
        self.size = 0.0

    def update(self, vector: FeatureVector) -> int:
        """The level of tremor, 0 while the hands are calm. Without valid hands it fades as the window empties."""
        channels, block = self._channels, vector.values[HANDS].tolist()
        for hand in range(MAX_HANDS):
            present, *position = block[5 * hand : 5 * hand + 3]
            for axis in range(2):
                channels[2 * hand + axis].update(position[axis] if present > 0.0 else None)
        self._steps += 1
        if self._steps >= WINDOW_STEPS:
            self.size = max(channel.magnitudes.median for channel in channels) * MEDIAN_TO_SD
            share = self._off / self._on
            begins = (self._on, *STRONGER)
            self.level = sum(
                self.size > (start * share if self.level > below else start) for below, start in enumerate(begins)
            )
        return self.level

    @property
    def trembling(self) -> bool:
        """Whether the hands tremble at all."""
        return self.level > 0


class _Channel:
    """One coordinate of one hand."""

    def __init__(self) -> None:
        self._band = BandPass()
        self._rest: float | None = None
        self.magnitudes = SlidingMedian(WINDOW_STEPS)

    def update(self, position: float | None) -> None:
        """The next position, None where the hand is not tracked."""
        if position is None:
            self._rest = None
            self.magnitudes.add(0.0)
            return
        if self._rest is None:
            # A hand that appears starts from where it is: a step in position is no oscillation.
            self._band, self._rest = BandPass(), position
        self.magnitudes.add(abs(self._band.step(position - self._rest)))


class BandPass:
    """The filter of `SECTIONS`, a sample at a time in plain floats."""

    def __init__(self) -> None:
        self._states = [(0.0, 0.0) for _ in SECTIONS]

    def step(self, x: float) -> float:
        """The next sample -> the filtered one."""
        for section, (b0, b1, b2, _, a1, a2) in enumerate(SECTIONS):
            first, second = self._states[section]
            y = b0 * x + first
            self._states[section] = (b1 * x - a1 * y + second, b2 * x - a2 * y)
            x = y
        return x


class SlidingMedian:
    """The median of the last `count` numbers, an even count, zeros before the first: they are kept in order."""

    def __init__(self, count: int) -> None:
        self._recent = deque([0.0] * count)
        self._ordered = [0.0] * count
        self._middle = count // 2

    def add(self, number: float) -> None:
        """The newest number for the oldest."""
        del self._ordered[bisect_left(self._ordered, self._recent.popleft())]
        self._recent.append(number)
        insort(self._ordered, number)

    @property
    def median(self) -> float:
        """Half way between the two in the middle."""
        return (self._ordered[self._middle - 1] + self._ordered[self._middle]) / 2.0
