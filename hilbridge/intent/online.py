"""Staying calibrated for one wearer: a temperature that follows, and an alarm when confidence stops meaning what it says.

Two of them learn from actions whose verb became known afterwards (annotated, confirmed, or recognised with certainty); where
nobody says, `ConfidenceDrift` watches confidence alone. The first
alarm is a bet against calibration that is valid at any time: a calibrated wearer raises it with a chance of at most
alpha, however long it watches (Ville's inequality).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hilbridge.intent.calibration import softmax

BETS = np.array([0.1, 0.2, 0.4, 0.8])
BLOCK_TICKS = 250  # ten seconds of belief


class DriftAlarm:
    """Watches for overconfidence. `update` once per action; True once the evidence is in, until `reset`."""

    def __init__(self, alpha: float = 0.01) -> None:
        if not 0.0 < alpha < 1.0:
            raise ValueError(f"alpha = {alpha}: must be between 0 and 1")
        self._limit = math.log(1.0 / alpha)
        self.reset()

    def reset(self) -> None:
        """Start watching anew, as after recalibration."""
        self._log_wealth = np.zeros(len(BETS))
        self.raised = False

    @property
    def log_wealth(self) -> float:
        """Log of what a unit bet against calibration has become."""
        return _mixed(self._log_wealth)

    def update(self, confidence: float, right: bool) -> bool:
        """confidence 0..1 claimed for an action's verb, and whether it was right. Numbers that are none do not count."""
        if 0.0 <= confidence <= 1.0:
            self._log_wealth += np.log1p(BETS * (confidence - float(right)))
            self.raised = self.raised or self.log_wealth >= self._limit
        return self.raised


class Usual(NamedTuple):
    """Between which bounds the mean confidence of a block of belief lay for the people of a bundle, each on average.

    condition: under which (`hilbridge.confidence`), the one they mostly had; others have maps of their own.
    """

    low: float
    high: float
    condition: int


class ConfidenceDrift:
    """Watches confidence where nobody says which verb was right: two bets against a wearer who is like the bundle's people.

    Such a wearer's next block of `BLOCK_TICKS` ticks has, whatever came before, an expected mean confidence between `low` and
    `high`; then the alarm is raised with a chance of at most alpha, however long it watches. It says that this wearer, or what
    the sensors see of them, is unlike those people, so that nobody knows what a confidence means here. Raised, it stays.
    """

    def __init__(self, usual: Usual, alpha: float = 0.01) -> None:
        if not (0.0 <= usual.low <= usual.high <= 1.0 and 0.0 < alpha < 1.0 and usual.condition > 0):
            raise ValueError(f"usual confidence {usual}, alpha {alpha}: must lie within 0..1, under a condition")
        self.usual = usual
        self._limit = math.log(2.0 / alpha)  # half of alpha for each side
        self._up = self._down = np.zeros(len(BETS))
        self._sum, self._ticks = 0.0, 0
        self.raised: str | None = None

    def update(self, confidence: float, condition: int | None) -> str | None:
        """One tick at which the gate looked at a candidate. `above` or `below` once the evidence is in."""
        if condition != self.usual.condition or not 0.0 <= confidence <= 1.0:
            return self.raised
        self._sum += confidence
        self._ticks += 1
        if self._ticks == BLOCK_TICKS:
            self._bet(self._sum / self._ticks)
            self._sum, self._ticks = 0.0, 0
        return self.raised

    def _bet(self, mean: float) -> None:
        # A block's mean is within 0..1, so that no bet loses more than its stake.
        self._up = self._up + np.log1p(BETS * (mean - self.usual.high))
        self._down = self._down + np.log1p(BETS * (self.usual.low - mean))
        if self.raised is None and _mixed(self._up) >= self._limit:
            self.raised = "above"
        elif self.raised is None and _mixed(self._down) >= self._limit:
            self.raised = "below"


def _mixed(log_wealth: NDArray[np.floating]) -> float:
    highest = float(log_wealth.max())
    return highest + math.log(float(np.exp(log_wealth - highest).mean()))


class OnlineTemperature:
    """One wearer's temperature, following the gradient of the NLL and held to the fitted one by a weak spring.

    rate: step per action in log T; spring: pull per action towards the fitted temperature. Labels never change.
    """

    def __init__(self, fitted: float, rate: float = 0.05, spring: float = 0.005) -> None:
        if not 0.01 <= fitted <= 100.0:
            raise ValueError(f"temperature {fitted}: must be 0.01 to 100")
        self._fitted = math.log(fitted)
        self._log_t = self._fitted
        self._rate, self._spring = rate, spring

    @property
    def temperature(self) -> float:
        """The temperature to use for the next action."""
        return math.exp(self._log_t)

    def update(self, logits: NDArray[np.floating], verb_index: int) -> float:
        """Learn from one action whose verb is known: logits (K,) of its window. Returns the new temperature."""
        scaled = np.asarray(logits, dtype=np.float64) / self.temperature
        if np.isfinite(scaled).all():
            # d NLL / d log T = scaled[label] - sum(p * scaled); limited, so that one odd action moves T by a few percent.
            slope = float(scaled[verb_index] - softmax(scaled) @ scaled)
            slope = min(1.0, max(-1.0, slope))
            self._log_t -= self._rate * slope + self._spring * (self._log_t - self._fitted)
            self._log_t = min(math.log(20.0), max(math.log(0.05), self._log_t))
        return self.temperature
