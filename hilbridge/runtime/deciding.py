"""From features to a decision: predictor, vetoes in their order, gate. Without clock or I/O; replay steps this very code.

What it is told is what a recording keeps of each tick: the features if there are new ones, the first sensor problem, the
bus's reason to hold, an overrun, the time. So the same recording and bundle give the same decisions to the last bit.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple, Protocol

from hilbridge.confidence import ALL_VALID, condition_of
from hilbridge.core import gate
from hilbridge.core.bridge import Command, sendable, sensing_age_ms
from hilbridge.core.gate import GateConfig, GateState
from hilbridge.core.sensing import Sensing
from hilbridge.intent.online import ConfidenceDrift, Usual
from hilbridge.limits import GAP_NS
from hilbridge.records import FeatureVector, GateDecision, HoldReason, IntentEstimate

# Nothing about the device goes before these two: a stop, and a fault that asks for somebody's hand.
_FIRST = frozenset({HoldReason.STOPPED, HoldReason.DEVICE_FAULT})
_UNSEEN = (False, False, False)
# The gate compared a confidence: nothing outside it held.
_LOOKED = frozenset(
    {
        HoldReason.NONE,
        HoldReason.VERB_NOT_ASSISTED,
        HoldReason.REFRACTORY,
        HoldReason.VERB_CHANGE,
        HoldReason.NOT_TOP_K,
        HoldReason.CONFIDENCE,
    }
)


class Predicts(Protocol):
    """What intent.predictor.Predictor provides."""

    def step(self, vector: FeatureVector, produced_ns: int) -> IntentEstimate | None: ...

    def reset(self) -> None: ...


class GuardsAgainstTremor(Protocol):
    """What intent.tremor.TremorGuard provides."""

    def update(self, vector: FeatureVector) -> int: ...


class Told(NamedTuple):
    """What one tick is told. `vector`: the newest features not yet seen, or None. `problem`: of a sensor, in words.

    `shaking`: whether inertial sensors feel a tremor; None where there are none.
    """

    vector: FeatureVector | None
    problem: str | None
    outside: HoldReason
    overrun: bool
    now_ns: int
    shaking: bool | None = None


class Decider:
    """Everything that decisions depend on between ticks."""

    def __init__(self, predict: Predicts, gate_config: GateConfig, tremor_guard: GuardsAgainstTremor) -> None:
        self.gate_config = gate_config
        self.gate_state = GateState()
        self.sensing = Sensing()
        self.estimate: IntentEstimate | None = None
        self.vector: FeatureVector | None = None
        self.tremor_level = 0
        self._predict = predict
        self._tremor_guard = tremor_guard
        self._gap: HoldReason | None = None
        usual = gate_config.usual
        self._drift = None if usual is None else ConfidenceDrift(Usual(*usual))

    def step(self, told: Told) -> GateDecision:
        """One 25 Hz tick: the gate's wish."""
        now_ns = told.now_ns
        torn = told.vector is not None and self._take(told.vector, now_ns)
        self._gap = self._why_blind(told, torn)
        self.sensing = self.sensing.step(self._gap, now_ns)
        self.gate_state, decision = gate.step(
            self.gate_config, self.gate_state, self.estimate, now_ns, self._veto(told), blind=self._gap
        )
        if self._drift is not None and told.vector is not None and decision.reason in _LOOKED:
            self._drift.update(decision.confidence, None if self.estimate is None else self.estimate.condition)
        return decision

    @property
    def drift(self) -> str | None:
        """`above` or `below` what is usual for the bundle's people, once confidence has drifted there; None until then."""
        return None if self._drift is None else self._drift.raised

    @property
    def seeing(self) -> FeatureVector | None:
        """The features that stand for what is seen; None where sensing cannot be believed.

        A window that only fills up, and an estimate that is absent, say nothing against what the sensors saw.
        """
        return self.vector if self._gap in (None, HoldReason.WARMING_UP) else None

    @property
    def oldest_input_ns(self) -> int | None:
        """Stamp of the oldest input of what is seen; sensing that cannot be believed has no age."""
        return None if self.seeing is None else self.seeing.oldest_input_ns

    @property
    def valid(self) -> tuple[bool, bool, bool]:
        """Which modalities of what is seen are valid."""
        return _UNSEEN if self.seeing is None else self.seeing.valid

    def _take(self, vector: FeatureVector, now_ns: int) -> bool:
        """New features into the predictor; whether there is a gap between them and the ones before."""
        torn = self.vector is not None and not 0 < vector.captured_ns - self.vector.captured_ns <= GAP_NS
        if torn:
            self._predict.reset()
        self.vector = vector
        self.tremor_level = self._tremor_guard.update(vector)
        estimate = self._predict.step(vector, now_ns)
        if estimate is not None and estimate.condition is not None:
            mask = estimate.condition & ALL_VALID
            estimate = replace(estimate, condition=condition_of(mask, self.tremor_level))
        self.estimate = estimate
        return torn

    @property
    def tremor(self) -> bool:
        """Whether tremor forbids ACT: always where belief was never measured under it, else where no confidence could do."""
        if not self.tremor_level:
            return False
        condition = None if self.estimate is None else self.estimate.condition
        return condition is None or self.gate_config.maps.highest(condition) < self.gate_config.tau_on

    def _why_blind(self, told: Told, torn: bool) -> HoldReason | None:
        """Why sensing is not whole in this tick; asked whatever else forbids ACT."""
        if told.overrun:
            return HoldReason.OVERRUN
        if told.problem is not None:
            return HoldReason.SENSOR_MISSING
        if torn or (self.vector is not None and self.estimate is None):
            return HoldReason.WARMING_UP
        return gate.estimate_problem(self.gate_config, self.estimate, told.now_ns)

    def _veto(self, told: Told) -> HoldReason | None:
        """The first reason to hold outside the gate, a cause before what follows from it."""
        if told.outside in _FIRST:
            return told.outside
        unearned = self.sensing.objection(told.now_ns)
        if unearned is not None:
            return unearned
        if told.outside is not HoldReason.NONE:
            return told.outside
        if self.tremor or told.shaking:
            return HoldReason.TREMOR
        return None if self.drift is None else HoldReason.DRIFT


def decided(decider: Decider, told: Told, before: Command) -> tuple[GateDecision, Command]:
    """One tick without a bus: the decision as it is sent, and the command that the next tick comes after."""
    wish = decider.step(told)
    age_ms = sensing_age_ms(decider.oldest_input_ns, told.now_ns)
    command = Command(*sendable(wish, told.outside, age_ms, before, decider.gate_config.vocabulary), told.now_ns)
    return as_sent(wish, command), command


def as_sent(wish: GateDecision, command: Command) -> GateDecision:
    """The gate's wish as the bridge put it on the bus."""
    verb_index = wish.verb_index if command.reason is HoldReason.NONE else None
    return GateDecision(command.action, verb_index, wish.confidence, command.reason)
