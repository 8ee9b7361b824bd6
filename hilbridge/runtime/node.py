"""The bridge's node: one tick of it, without clock, threads or I/O. Live runs and virtual time step this very code.

The way of the data: features -> intent -> gate -> protocol -> frames. Every tick gives a row that says what was decided,
on what, and why.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from hilbridge.bus.model.error_frames import ErrorState
from hilbridge.core import gate
from hilbridge.core.bridge import Bridge
from hilbridge.core.gate import GateConfig, GateState
from hilbridge.core.sensing import Sensing
from hilbridge.core.session import Session
from hilbridge.limits import GAP_NS
from hilbridge.records import FeatureVector, Frame, GateDecision, HoldReason, IntentEstimate
from hilbridge.rows import TickRow
from hilbridge.runtime.account.spells import Spell
from hilbridge.runtime.health import SensorSeen, first_problem
from hilbridge.verbs import VERBS
from hilbridge.wire.codec import Decoded, RejectReason
from hilbridge.wire.link import WireLink

# Nothing about the device goes before these two: a stop, and a fault that asks for somebody's hand.
_FIRST = frozenset({HoldReason.STOPPED, HoldReason.DEVICE_FAULT})

_BUS_STATES = {  # of BRIDGE_DIAG; 0 is unknown
    ErrorState.ACTIVE: 1,
    ErrorState.WARNING: 2,
    ErrorState.PASSIVE: 3,
    ErrorState.BUS_OFF: 4,
}


class Predicts(Protocol):
    """What intent.predictor.Predictor provides."""

    def step(self, vector: FeatureVector, produced_ns: int) -> IntentEstimate | None: ...

    def reset(self) -> None: ...


@dataclass(frozen=True, slots=True)
class Tick:
    """What one tick came to: frames to send in order, the decision as sent, and a row for the recording."""

    frames: list[Frame]
    decision: GateDecision
    row: TickRow


class GuardsAgainstTremor(Protocol):
    """What intent.tremor.TremorGuard provides."""

    def update(self, vector: FeatureVector) -> bool: ...


class BridgeNode:
    """Everything the bridge knows between ticks.

    predict: the predictor. bundle_id: its 16-bit identity on the bus. tremor_guard: says whether hands shake (H6).
    on_event: told in words what a person would want to know, with the time.
    """

    def __init__(
        self,
        predict: Predicts,
        gate_config: GateConfig,
        bridge: Bridge,
        wire: WireLink,
        bundle_id: int,
        tremor_guard: GuardsAgainstTremor,
        on_event: Callable[[int, str], None] = lambda now_ns, text: None,
    ) -> None:
        self.bridge = bridge
        self.wire = wire
        self.gate_config = gate_config
        self.gate_state = GateState()
        self.sensing = Sensing()
        self._predict = predict
        self._bundle_id = bundle_id
        self._tremor_guard = tremor_guard
        self._tremor = False
        self._on_event = on_event
        self._estimate: IntentEstimate | None = None
        self._vector: FeatureVector | None = None
        self._said: dict[str, object] = {}
        self._sensor_trouble = Spell()
        self.foreign = 0  # frames of others under identifiers that only this bridge may send

    def receive(self, frame: Frame, now_ns: int) -> tuple[Decoded | None, list[Frame]]:
        """Take in one frame: what it said (None when it was rejected, and counted) and what must be answered at once."""
        outcome = self.wire.decode(frame)
        if not isinstance(outcome, Decoded):
            if outcome.reason is RejectReason.UNKNOWN_ID and outcome.name:
                self.foreign += 1
                self.bridge.session.on_stranger(outcome.name, now_ns)
            return None, []
        answers = self.bridge.on_message(outcome.name, outcome.signals, outcome.counter, now_ns)
        if outcome.name == "CTRL_STATUS":
            self._say("device", outcome.signals["State"], now_ns, f"device: {outcome.signals['State']}")
        elif outcome.name == "CTRL_EMCY":
            code, state = outcome.signals["Code"], outcome.signals["State"]
            self._on_event(now_ns, f"device emergency: {code} in {state}")
        return outcome, answers

    def on_bus_state(self, controller: ErrorState, *, link_up: bool = True) -> None:
        """The controller chip or its link is in another state. A chip that is bus-off sends as little as one unlinked."""
        bus_off = controller is ErrorState.BUS_OFF
        self.bridge.on_bus_state(_BUS_STATES.get(controller, 0), bus_off)
        if bus_off or not link_up:
            self.bridge.on_send_failed(bus_down=True)

    def tick(self, vector: FeatureVector | None, sensors: tuple[SensorSeen, ...], now_ns: int) -> Tick:
        """One 25 Hz tick. `vector` is the newest features not yet seen, or None."""
        self.bridge.begin_tick(now_ns)
        problem = first_problem(sensors, now_ns)
        self._say_sensors(problem, now_ns)
        torn = vector is not None and self._take(vector, now_ns)
        gap = self._gap(problem, torn, now_ns)
        self.sensing = self.sensing.step(gap, now_ns)
        self.gate_state, decision = gate.step(
            self.gate_config, self.gate_state, self._estimate, now_ns, self._veto(now_ns), blind=gap
        )
        # Sensing that cannot be believed has no age: the device is told so, and falls back to following by itself.
        # A window that only fills up, and an estimate that is absent, say nothing against what the sensors saw.
        seeing = self._vector if gap in (None, HoldReason.WARMING_UP) else None
        oldest_ns = None if seeing is None else seeing.oldest_input_ns
        valid = (False, False, False) if seeing is None else seeing.valid
        frames = self.bridge.tick(decision, oldest_ns, valid, self._bundle_id, now_ns)
        command = self.bridge.command
        sent = GateDecision(
            command.action,
            decision.verb_index if command.reason is HoldReason.NONE else None,
            decision.confidence,
            command.reason,
        )
        session = self.bridge.session
        self._say("armed", (session.armed, session.refused, session.disturbed), now_ns, _arming(session))
        return Tick(frames, sent, self._row(sent, problem, vector, now_ns))

    def _take(self, vector: FeatureVector, now_ns: int) -> bool:
        """New features into the predictor; whether there is a gap between them and the ones before."""
        torn = self._vector is not None and not 0 < vector.captured_ns - self._vector.captured_ns <= GAP_NS
        if torn:
            self._predict.reset()
        self._vector = vector
        self._estimate = self._predict.step(vector, now_ns)
        self._tremor = self._tremor_guard.update(vector)
        self._say("tremor", self._tremor, now_ns, "tremor in the hands" if self._tremor else "no tremor in the hands")
        return torn

    def _gap(self, problem: str | None, torn: bool, now_ns: int) -> HoldReason | None:
        """Why sensing is not whole in this tick; asked whatever else forbids ACT."""
        if self.bridge.overrun:
            return HoldReason.OVERRUN
        if problem is not None:
            return HoldReason.SENSOR_MISSING
        if torn or (self._vector is not None and self._estimate is None):
            return HoldReason.WARMING_UP
        return gate.estimate_problem(self.gate_config, self._estimate, now_ns)

    def _veto(self, now_ns: int) -> HoldReason | None:
        """The first reason to hold outside the gate, a cause before what follows from it."""
        outside = self.bridge.veto(now_ns)
        if outside in _FIRST:
            return outside
        unearned = self.sensing.objection(now_ns)
        if unearned is not None:
            return unearned
        if outside is not HoldReason.NONE:
            return outside
        return HoldReason.TREMOR if self._tremor else None

    def _say_sensors(self, problem: str | None, now_ns: int) -> None:
        if (told := self._sensor_trouble.look(problem, now_ns)) is not None:
            self._on_event(now_ns, f"sensors: {told}")

    def _say(self, subject: str, value: object, now_ns: int, text: str) -> None:
        if self._said.get(subject, self) != value:
            self._said[subject] = value
            self._on_event(now_ns, text)

    def _row(self, decision: GateDecision, problem: str | None, vector: FeatureVector | None, now_ns: int) -> TickRow:
        estimate, device, newest = self._estimate, self.bridge.device, self._vector
        return TickRow(
            now_ns,
            decision.action,
            decision.reason,
            round(decision.confidence, 4),
            None if decision.verb_index is None else VERBS[decision.verb_index],
            top=() if estimate is None else _likeliest(estimate),
            top_confidence=None if estimate is None else round(estimate.confidence, 4),
            valid=(False, False, False) if newest is None else newest.valid,
            sensing_age_ms=None if newest is None else round((now_ns - newest.oldest_input_ns) / 1e6, 2),
            sensor_problem=problem,
            new_features=vector is not None,
            device_state=None if device is None else device.state,
            armed=self.bridge.session.armed,
        )


def _likeliest(estimate: IntentEstimate) -> tuple[tuple[str, float], ...]:
    """The three likeliest verbs with their probabilities."""
    ranked = sorted(range(len(estimate.probabilities)), key=estimate.probabilities.__getitem__, reverse=True)
    return tuple((VERBS[k], round(estimate.probabilities[k], 4)) for k in ranked[:3])


def _arming(session: Session) -> str:
    if session.armed:
        return "armed"
    if session.refused:
        return "not armed: the device rejects our key; give both the same key file, then start the device anew"
    if session.disturbed:
        return f"not armed: {session.disturbed} handshakes disturbed, somebody else asks too; trying again"
    return f"not armed {session.why}".strip()
