"""What was done before as a prior for what comes next, taken from what the system itself believed.

Nobody labels the wearer's actions while the bridge runs, so the history is a distribution: the forward recursion of a
hidden Markov chain whose transitions come from annotated sessions and whose evidence is the sensors' own posterior,
tempered because the network's windows say less than they claim to.

`BelievedHistory` advances at action boundaries, which annotated sessions have. `HistoryFilter` needs none: at 25 Hz the
next action begins in any step with a small, fixed chance, and the belief carries on by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class HistoryPrior:
    """transitions (K, K): P(next | before), rows summing to 1; start (K,); marginal (K,): what the network was trained
    under; trust 0..1: the exponent of the sensors' evidence. Raises ValueError for what is no distribution."""

    transitions: Floats
    start: Floats
    marginal: Floats
    trust: float

    def __post_init__(self) -> None:
        for name in ("transitions", "start", "marginal"):
            value = getattr(self, name)
            if not (np.isfinite(value).all() and (value >= 0).all() and np.allclose(value.sum(axis=-1), 1.0)):
                raise ValueError(f"{name}: must be probabilities that sum to 1")
        if (self.marginal <= 0).any():
            raise ValueError("marginal: every class needs some probability")
        if not 0.0 <= self.trust <= 1.0:
            raise ValueError(f"trust = {self.trust}: must be between 0 and 1")


class BelievedHistory:
    """One stream's belief about what was done last."""

    def __init__(self, prior: HistoryPrior) -> None:
        self._prior = prior
        self._believed: Floats | None = None

    def reset(self) -> None:
        """Forget what was done."""
        self._believed = None

    def fuse(self, probabilities: Floats) -> Floats:
        """Sensors' posterior (K,) and history -> fused belief (K,) about the next action. Changes nothing."""
        expected = self._prior.start if self._believed is None else self._believed @ self._prior.transitions
        evidence = (np.maximum(probabilities, 1e-9) / self._prior.marginal) ** self._prior.trust
        fused = expected * evidence
        return np.asarray(fused / fused.sum())

    def advance(self, believed: Floats) -> None:
        """An action began: `believed` (K,) is what the system thinks it is."""
        self._believed = np.asarray(believed, dtype=np.float64)


class HistoryFilter:
    """A stream's belief at 25 Hz, without a detector of action boundaries.

    hazard: chance per step that another action takes over (40 ms over the mean time between onsets). `prior.trust` is
    the evidence's exponent per step: neighbouring windows share most of what they show, so it is far below 1.
    Raises ValueError for a hazard that is no chance.
    """

    def __init__(self, prior: HistoryPrior, hazard: float) -> None:
        if not 0.0 < hazard < 1.0:
            raise ValueError(f"hazard = {hazard}: must be between 0 and 1")
        self._prior = prior
        self._hazard = hazard
        self._belief: Floats | None = None

    def reset(self) -> None:
        """Forget the stream, as after a gap."""
        self._belief = None

    def step(self, probabilities: Floats) -> Floats:
        """The sensors' posterior (K,) of one step -> the belief (K,) that history and sensors give together."""
        prior = self._prior
        if self._belief is None:
            expected = prior.start
        else:
            expected = (1.0 - self._hazard) * self._belief + self._hazard * (self._belief @ prior.transitions)
        evidence = (np.maximum(probabilities, 1e-9) / prior.marginal) ** prior.trust
        belief = expected * evidence
        self._belief = belief / belief.sum()
        return np.asarray(self._belief)
