"""Staying calibrated for one wearer: a temperature that follows, and an alarm when confidence stops meaning what it says.

Both learn from actions whose verb became known afterwards (annotated, confirmed, or recognised with certainty). The
alarm is a bet against calibration that is valid at any time: a calibrated wearer raises it with a chance of at most
alpha, however long it watches (Ville's inequality).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hilbridge.intent.calibration import softmax

BETS = np.array([0.1, 0.2, 0.4, 0.8])


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
        highest = float(self._log_wealth.max())
        return highest + math.log(float(np.exp(self._log_wealth - highest).mean()))

    def update(self, confidence: float, right: bool) -> bool:
        """confidence 0..1 claimed for an action's verb, and whether it was right. Numbers that are none do not count."""
        if 0.0 <= confidence <= 1.0:
            self._log_wealth += np.log1p(BETS * (confidence - float(right)))
            self.raised = self.raised or self.log_wealth >= self._limit
        return self.raised


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
