"""The bridge's node: one tick of it, without clock, threads or I/O. Live runs and virtual time step this very code.

The way of the data: features -> intent -> gate -> protocol -> frames. Every tick gives a row that says what was decided,
on what, and why.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from hilbridge.bus.model.error_frames import ErrorState
from hilbridge.core.bridge import Bridge
from hilbridge.core.gate import GateConfig
from hilbridge.core.session import Session
from hilbridge.records import Action, FeatureVector, Frame, GateDecision, IntentEstimate
from hilbridge.rows import TickRow
from hilbridge.runtime.account.spells import Spell
from hilbridge.runtime.deciding import Decider, GuardsAgainstTremor, Predicts, Told, as_sent
from hilbridge.runtime.health import SensorSeen, first_problem, still_seen
from hilbridge.wire.codec import Decoded, RejectReason
from hilbridge.wire.link import WireLink

_BUS_STATES = {  # of BRIDGE_DIAG; 0 is unknown
    ErrorState.ACTIVE: 1,
    ErrorState.WARNING: 2,
    ErrorState.PASSIVE: 3,
    ErrorState.BUS_OFF: 4,
}


_UNKNOWN_US = 0xFFFFFFFF


@dataclass(frozen=True, slots=True)
class Tick:
    """What one tick came to: frames to send in order, the decision as sent, a row for the recording, and the belief in
    new features, where there is one.
    """

    frames: list[Frame]
    decision: GateDecision
    row: TickRow
    belief: IntentEstimate | None


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
        self.decider = Decider(predict, gate_config, tremor_guard)
        self._bundle_id = bundle_id
        self._first = True
        self._on_event = on_event
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

    def on_clock(self, bound_ns: int | None, residual_ns: int) -> None:
        """How well the least known clock of a live device is known, for BRIDGE_DIAG; None: not at all just now."""
        self.bridge.diag["ClockBoundUs"] = _UNKNOWN_US if bound_ns is None else min(bound_ns // 1000, _UNKNOWN_US)
        self.bridge.diag["ClockResidualUs"] = min(residual_ns // 1000, _UNKNOWN_US)

    def tick(
        self,
        vector: FeatureVector | None,
        sensors: tuple[SensorSeen, ...],
        now_ns: int,
        shaking: bool | None = None,
    ) -> Tick:
        """One 25 Hz tick. `vector` is the newest features not yet seen, or None; `shaking` what inertial sensors feel."""
        bridge, decider = self.bridge, self.decider
        bridge.begin_tick(now_ns)
        problem = first_problem(sensors, now_ns)
        self._say_sensors(problem, now_ns)
        told = Told(vector, problem, bridge.veto(now_ns), bridge.overrun, now_ns, shaking)
        wish = decider.step(told)
        if vector is not None or shaking:
            trembling = decider.tremor or bool(shaking)
            said = "tremor in the hands" if trembling else "no tremor in the hands"
            self._say("tremor", trembling, now_ns, said)
        if decider.drift is not None:
            self._say("drift", decider.drift, now_ns, _drifted(decider.drift, decider.gate_config.usual))
        # Sensing that cannot be believed has no age: the device is told so, and falls back to following by itself.
        valid = decider.valid
        if problem is not None and decider.vector is not None:  # who looks on is told which sensor it is
            valid = still_seen(decider.vector.valid, sensors, now_ns)
        frames = bridge.tick(wish, decider.oldest_input_ns, valid, self._bundle_id, now_ns)
        sent = as_sent(wish, bridge.command)
        session = bridge.session
        self._say("armed", (session.armed, session.refused, session.disturbed), now_ns, _arming(session))
        row = self._row(sent, told)
        self._first = False
        return Tick(frames, sent, row, None if vector is None else decider.estimate)

    def _say_sensors(self, problem: str | None, now_ns: int) -> None:
        if (told := self._sensor_trouble.look(problem, now_ns)) is not None:
            self._on_event(now_ns, f"sensors: {told}")

    def _say(self, subject: str, value: object, now_ns: int, text: str) -> None:
        if self._said.get(subject, self) != value:
            self._said[subject] = value
            self._on_event(now_ns, text)

    def _row(self, decision: GateDecision, told: Told) -> TickRow:
        decider, device, now_ns = self.decider, self.bridge.device, told.now_ns
        estimate, newest = decider.estimate, decider.vector
        verbs = decider.gate_config.vocabulary
        gaze, hands, scene = (False, False, False) if newest is None else newest.valid
        return TickRow(
            now_ns,
            decision.action,
            decision.reason,
            decision.confidence,
            verbs.name(decision.verb_index),
            tau_on=decider.gate_config.tau_on,
            tau_off=decider.gate_config.tau_off,
            act=float(decision.action is Action.ACT),
            top_verb=None if estimate is None else verbs.name(estimate.verb_index),
            top_confidence=None if estimate is None else estimate.confidence,
            gaze_valid=gaze,
            hands_valid=hands,
            scene_valid=scene,
            sensing_age_ms=None if newest is None else round((now_ns - newest.oldest_input_ns) / 1e6, 2),
            sensor_problem=told.problem,
            new_features=told.vector is not None,
            features_ns=None if told.vector is None else told.vector.captured_ns,
            first=self._first,
            outside=told.outside,
            overrun=told.overrun,
            tremor=decider.tremor,
            felt_tremor=told.shaking,
            device_state=None if device is None else device.state,
            armed=self.bridge.session.armed,
        )


def _drifted(side: str, usual: tuple[float, float, int] | None) -> str:
    bounds = "" if usual is None else f" ({usual[0]:.2f} to {usual[1]:.2f} on average)"
    return (
        f"drift: confidence is {side} what it was for the bundle's people{bounds}; HOLD until the bridge starts anew: check "
        "the sensors, label sessions of this wearer and train or adapt"
    )


def _arming(session: Session) -> str:
    if session.armed:
        return "armed"
    if session.refused:
        return "not armed: the device rejects our key; give both the same key file, then start the device anew"
    if session.disturbed:
        return f"not armed: {session.disturbed} handshakes disturbed, somebody else asks too; trying again"
    return f"not armed {session.why}".strip()
