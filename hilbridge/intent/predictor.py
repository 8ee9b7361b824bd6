"""FeatureVector in, IntentEstimate out, once per 25 Hz tick (paper, "Inputs and Encoder", "Calibration")."""

from __future__ import annotations

from collections import deque

import numpy as np

from hilbridge.confidence import condition_of
from hilbridge.intent.bundle import Bundle
from hilbridge.intent.calibration import softmax
from hilbridge.intent.gru import StreamingGru
from hilbridge.intent.standardise import standardise
from hilbridge.records import FeatureVector, IntentEstimate

MIN_USABLE_SHARE = 0.5  # of the window's steps; the paper discards windows with too few valid samples


class Predictor:
    """One stream's belief. A gap in the stream is the caller's to report with `reset`."""

    def __init__(self, bundle: Bundle) -> None:
        self._bundle = bundle
        self._engine = StreamingGru(bundle.weights, bundle.window_steps)
        self._valid: deque[tuple[bool, bool, bool]] = deque(maxlen=bundle.window_steps)
        self._counts = [0, 0, 0]

    def reset(self) -> None:
        """Forget the window so far."""
        self._engine.reset()
        self._valid.clear()
        self._counts = [0, 0, 0]

    def step(self, vector: FeatureVector, produced_ns: int) -> IntentEstimate | None:
        """The belief after this step; None until 2 s are seen or while less than half of them were usable."""
        self._remember(vector.valid)
        x = standardise(vector.values, np.array(vector.valid), self._bundle.mean, self._bundle.std)
        logits = self._engine.step(x, any(vector.valid))
        if logits is None or self._engine.usable_steps() < MIN_USABLE_SHARE * self._bundle.window_steps:
            return None
        mask = self.mask()
        probabilities = softmax(np.asarray(logits, dtype=np.float64) / self._bundle.temperatures.get(mask, 1.0))
        top = int(logits.argmax())
        return IntentEstimate(
            oldest_input_ns=vector.oldest_input_ns,
            produced_ns=produced_ns,
            probabilities=tuple(probabilities.tolist()),
            verb_index=top,
            confidence=float(probabilities[top]),
            bundle_id=self._bundle.bundle_id,
            valid=vector.valid,
            condition=condition_of(mask),
        )

    def mask(self) -> int:
        """Bits of the modalities that are valid in at least half of the window: this set's temperature and map are used."""
        return sum(1 << bit for bit, count in enumerate(self._counts) if 2 * count >= max(1, len(self._valid)))

    def _remember(self, valid: tuple[bool, bool, bool]) -> None:
        if len(self._valid) == self._valid.maxlen:
            for bit, flag in enumerate(self._valid[0]):
                self._counts[bit] -= flag
        self._valid.append(valid)
        for bit, flag in enumerate(valid):
            self._counts[bit] += flag
