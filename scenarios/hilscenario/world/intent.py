"""Sources of estimates: the real predictor, an earlier run, or a script."""

from __future__ import annotations

from hilbridge.intent.bundle import Bundle
from hilbridge.intent.predictor import Predictor
from hilbridge.records import FeatureVector, IntentEstimate
from hilbridge.runtime.deciding import Predicts
from hilscenario.format.schema import Estimate, Scenario, Session
from hilscenario.world.parts import bundle
from hilscenario.world.replayed import Believed


class Scripted:
    """Gives the scripted `verb` and `confidence` from each estimate's time on; None before the first."""

    def __init__(self, script: tuple[Estimate, ...], start_ns: int = 0) -> None:
        self._script = sorted(script, key=lambda estimate: estimate.at)
        self._start_ns = start_ns

    def step(self, vector: FeatureVector, produced_ns: int) -> IntentEstimate:
        names = bundle().vocabulary.names
        verb, confidence = 0, 1.0 / len(names)
        for estimate in self._script:
            if produced_ns - self._start_ns >= estimate.at:
                verb, confidence = names.index(estimate.verb), estimate.confidence
        rest = (1.0 - confidence) / (len(names) - 1)
        probabilities = tuple(confidence if index == verb else rest for index in range(len(names)))
        return IntentEstimate(
            vector.oldest_input_ns, produced_ns, probabilities, verb, confidence, bundle().bundle_id, vector.valid
        )

    def reset(self) -> None: ...


def make_predictor(scenario: Scenario, start_ns: int = 0, own: Bundle | None = None) -> Predicts:
    """The scenario's source of intent; `start_ns` is its beginning on the caller's clock.

    `own`: a bundle in place of the one that ships.
    """
    if isinstance(scenario.intent, tuple):
        return Scripted(scenario.intent, start_ns)
    if isinstance(scenario.intent, Session) and scenario.intent.replays_beliefs:
        return Believed(scenario.intent, scenario.duration, bundle().bundle_id, start_ns)
    return Predictor(own or bundle())
