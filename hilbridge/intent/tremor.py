"""The tremor guard: confidence must not survive an involuntary oscillation of the hands (issue 6).

Under tremor the network sees hands that reach and withdraw several times a second and can be confident about nothing.
The guard looks at the tracked hand positions themselves: band-passed from 3 to 11.5 Hz, the median magnitude over the
last 1.28 s. A median, because reaching is a brief broadband movement that must not count as tremor. At 25 Hz nothing
above 12.5 Hz can be seen; tremor of 12 Hz beats with the sampling and passes unseen, which docs/learning.md says.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hilbridge.features.layout import HANDS, MAX_HANDS
from hilbridge.records import FeatureVector

# scipy.signal.butter(2, [3.0, 11.5], btype="band", fs=25, output="sos"): written out, as intent needs numpy only.
SECTIONS = (
    (0.4808384292640905, -0.961676858528181, 0.4808384292640905, 1.0, -0.9593878879281492, 0.35835169557701924),
    (1.0, 2.0, 1.0, 1.0, 1.6454265073056196, 0.7041256659214957),
)
WINDOW_STEPS = 32
MEDIAN_TO_SD = 1.4826  # of a Gaussian; for a sine the figure is a little above its standard deviation
ON = 0.006  # picture widths; calm hands stay below in 96 % of steps, a tremor of 0.02 is above in 95 %
OFF = 0.005


class TremorGuard:
    """One wearer's guard. `update` once per 25 Hz step."""

    def __init__(self, on: float = ON, off: float = OFF) -> None:
        if not 0.0 < off <= on:
            raise ValueError(f"tremor thresholds on {on}, off {off}: need 0 < off <= on")
        self._on, self._off = on, off
        self.reset()

    def reset(self) -> None:
        """Forget the hands."""
        channels = 2 * MAX_HANDS
        self._state = np.zeros((len(SECTIONS), 2, channels))
        self._rest = np.full(channels, np.nan)
        self._magnitude = np.zeros((WINDOW_STEPS, channels))  # a ring; `_steps` says where it goes on
        self._steps = 0
        self.trembling = False
        self.level = 0.0

    def update(self, vector: FeatureVector) -> bool:
        """True while the hands tremble. Without valid hands the last judgement fades as its window empties."""
        block = vector.values[HANDS].reshape(MAX_HANDS, 5)
        present = np.repeat(block[:, 0] > 0.0, 2)
        position = block[:, 1:3].astype(np.float64).ravel()
        # A hand that appears starts from where it is: a step in position is no oscillation.
        appeared = present & np.isnan(self._rest)
        self._state[:, :, appeared | ~present] = 0.0
        self._rest = np.where(appeared, position, np.where(present, self._rest, np.nan))
        filtered = self._band_pass(np.where(present, position - np.nan_to_num(self._rest), 0.0))
        self._magnitude[self._steps % WINDOW_STEPS] = np.where(present, np.abs(filtered), 0.0)
        self._steps += 1
        if self._steps >= WINDOW_STEPS:
            self.level = _largest_median(self._magnitude) * MEDIAN_TO_SD
            self.trembling = self.level > (self._off if self.trembling else self._on)
        return self.trembling

    def _band_pass(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        for section, (b0, b1, b2, _, a1, a2) in enumerate(SECTIONS):
            state = self._state[section]
            y = b0 * x + state[0]
            state[0] = b1 * x - a1 * y + state[1]
            state[1] = b2 * x - a2 * y
            x = y
        return x


def _largest_median(columns: NDArray[np.float64]) -> float:
    """As `np.median(columns, axis=0).max()` for an even number of rows, at a tenth of its cost."""
    half = len(columns) // 2
    middle = np.sort(columns, axis=0)[half - 1 : half + 1]
    return float((middle[0] + middle[1]).max()) / 2.0
