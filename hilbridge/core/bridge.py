"""The bridge's half of the bus protocol, as a pure machine: messages and ticks in, frames out (docs/protocol.md).

It turns the gate's wish into ACT_CMD and ACT_AUTH, and whatever is wrong on the bus into a named veto for the gate.
The frames come back in the order in which they must be sent; nothing is ever sent by a periodic task of a library, so
that a hung bridge falls silent.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, Protocol

from hilbridge.core.deadline import Deadline
from hilbridge.core.session import Crypto, Purpose, Session
from hilbridge.limits import (
    AGE_STEP_MS,
    AGE_UNKNOWN_MS,
    HEARTBEAT_NS,
    MS,
    OVERRUN_NS,
    PROTOCOL_VERSION,
    SENSING_LIMIT_MS,
    STATUS_LIMIT_NS,
    STOP_GAP_NS,
    STOP_REPEATS,
    TICK_NS,
)
from hilbridge.records import Action, Frame, GateDecision, HoldReason
from hilbridge.verbs import DEFAULT, Vocabulary

_UNREADY = ("Boot", "SelfTest", "Follow", "RampDown")
_FAULTS = ("Passive", "Latched")
# What the bridge itself counts, by name of BRIDGE_DIAG.
_COUNTED = [
    "TxQueueFull",
    "TxBusDown",
    "SessionsDropped",
    "Overruns",
    "TickLateMaxUs",
    "BusState",
    "Acts",
    "Holds",
    "StatusSilences",
]

Value = int | float | str


class Wire(Protocol):
    """What hilbridge.wire.link.WireLink provides: the next protected frame of a message."""

    def encode(self, message: str, signals: Mapping[str, Value]) -> Frame:
        """Encode, count, protect."""


class BridgeState(StrEnum):
    """What the bridge says of itself in BRIDGE_HB; names of the DBC's value table."""

    STARTING = "Starting"
    RUNNING = "Running"


class DeviceStatus(NamedTuple):
    """The last CTRL_STATUS: state, reason and verb under their DBC names, authority in percent."""

    state: str
    reason: str
    applied_verb: str
    authority: int
    accepted_counter: int
    session: int
    armed: bool
    assist_zero: bool
    counter: int
    received_ns: int


@dataclass(frozen=True, slots=True)
class Command:
    """What the last tick put on the bus, and why it held."""

    action: Action
    verb: str
    reason: HoldReason
    sent_ns: int


@dataclass(frozen=True, slots=True)
class BridgeConfig:
    """`arm`: whether to ask the device for a session. `listen_only`: send nothing at all. `vocabulary`: the decisions'."""

    arm: bool = True
    listen_only: bool = False
    vocabulary: Vocabulary = DEFAULT


def sensing_age_ms(oldest_input_ns: int | None, now_ns: int) -> int:
    """Age of the newest feature vector's oldest input in ms, rounded up to the wire's 2 ms; 510 is unknown or older."""
    if oldest_input_ns is None or oldest_input_ns > now_ns:
        return AGE_UNKNOWN_MS
    steps = -((oldest_input_ns - now_ns) // (AGE_STEP_MS * MS))
    return min(AGE_STEP_MS * steps, AGE_UNKNOWN_MS)


def sendable(
    decision: GateDecision | None, veto: HoldReason, age_ms: int, before: Command, vocabulary: Vocabulary = DEFAULT
) -> tuple[Action, str, HoldReason]:
    """A decision as it may go on the bus after `before`: against a veto, or on input too old, it is HOLD."""
    if decision is None:
        return Action.HOLD, "None", HoldReason.NO_ESTIMATE if veto is HoldReason.NONE else veto
    if decision.action is not Action.ACT or veto is not HoldReason.NONE:
        return Action.HOLD, "None", veto if decision.action is Action.ACT else decision.reason
    if age_ms > SENSING_LIMIT_MS:
        return Action.HOLD, "None", HoldReason.STALE
    if decision.verb_index is None or decision.verb_index in vocabulary.never_assisted:
        return Action.HOLD, "None", HoldReason.VERB_NOT_ASSISTED  # the gate has said so already, of its own vocabulary
    verb = vocabulary.wire_name(decision.verb_index)
    if before.action is Action.ACT and before.verb != verb:
        return Action.HOLD, "None", HoldReason.VERB_CHANGE
    return Action.ACT, verb, HoldReason.NONE


class Bridge:
    """One bridge on one bus. Not thread safe; call from one loop. Exposes `device`, `session`, `command`, `diag`."""

    def __init__(
        self,
        wire: Wire,
        crypto: Crypto,
        nonce: Callable[[], int],
        config: BridgeConfig,
        counters: Callable[[], Mapping[str, int]],
    ) -> None:
        """`nonce` gives unpredictable 32-bit numbers; `counters` the wire's and port's counts by BRIDGE_DIAG name."""
        self._wire = wire
        self._nonce = nonce
        self._config = config
        self._counters = counters
        self.session = Session(crypto)
        self.device: DeviceStatus | None = None
        self.device_diag: dict[str, int] = {}
        self.emergencies: list[tuple[int, str, str]] = []
        self.command = Command(Action.HOLD, "None", HoldReason.NO_ESTIMATE, 0)
        self.stopped = False
        self.diag = dict.fromkeys(_COUNTED, 0)
        self._status = Deadline(STATUS_LIMIT_NS)
        self._last_tick_ns: int | None = None
        self.overrun = False
        self._heartbeat_due_ns = 0
        self._stops: tuple[int, ...] = ()
        self._clear_wanted = False
        self._clear_asked = False
        self._diag_names: list[str] = []
        self._diag_index = 0

    # From the bus

    def on_message(self, name: str, signals: Mapping[str, Value], counter: int, now_ns: int) -> list[Frame]:
        """Take in one accepted message of the device; returns what has to be answered at once."""
        if name == "CTRL_STATUS":
            self._on_status(signals, counter, now_ns)
        elif name == "CTRL_HB":
            if signals["ProtocolVersion"] == PROTOCOL_VERSION:
                self.session.on_heartbeat(int(signals["BootNonce"]))
        elif name == "ARM_CHALLENGE":
            response = self.session.on_challenge(int(signals["DeviceNonce"]), int(signals["Session"]), now_ns)
            if response is not None:
                return self._sendable("ARM_RESPONSE", response)
        elif name == "CTRL_EMCY":
            self.emergencies.append((now_ns, str(signals["Code"]), str(signals["State"])))
        elif name == "CTRL_DIAG":
            index = str(signals["Index"])
            self.device_diag[index] = int(signals[index])
            if index == "MacFailures":
                self.session.on_mac_failures(self.device_diag[index])
        elif name == "STOP":
            self.stopped = True
            self.session.drop("stop")
        return []

    def _on_status(self, signals: Mapping[str, Value], counter: int, now_ns: int) -> None:
        device = DeviceStatus(
            str(signals["State"]),
            str(signals["Reason"]),
            str(signals["AppliedVerb"]),
            int(signals["Authority"]),
            int(signals["AcceptedCounter"]),
            int(signals["Session"]),
            bool(signals["Armed"]),
            bool(signals["AssistZero"]),
            counter,
            now_ns,
        )
        if self.device is not None and self.device.state == "EStop" and device.state != "EStop":
            self.stopped = False  # somebody has cleared the stop at the device
        self.device = device
        self._status = self._status.fed(now_ns)
        self.session.on_status(device.armed, device.session)

    def on_send_failed(self, bus_down: bool) -> None:
        """A frame did not go out: what waits in a queue cannot be trusted later, so the session ends."""
        self.diag["TxBusDown" if bus_down else "TxQueueFull"] += 1
        self.session.drop("bus down" if bus_down else "transmit queue full")

    def on_bus_state(self, code: int, bus_off: bool) -> None:
        """State of the controller chip, for BRIDGE_DIAG (0 unknown, 1 active, 2 warning, 3 passive, 4 off)."""
        self.diag["BusState"] = code
        if bus_off:
            self.session.drop("bus-off")

    # Wishes of the operator

    def request_stop(self, now_ns: int) -> list[Frame]:
        """STOP: the first frame now, the others from `poll` at 10 ms."""
        self.stopped = True
        self.session.drop("stop")
        self._stops = tuple(now_ns + STOP_GAP_NS * k for k in range(STOP_REPEATS))
        return self.poll(now_ns)

    @property
    def is_stopping(self) -> bool:
        """STOP frames are still to come from `poll`."""
        return bool(self._stops)

    def request_clear_latch(self) -> None:
        """Authenticate the clearing of a latch or stop, until the hand at the device has cleared it."""
        self._clear_wanted = True

    def poll(self, now_ns: int) -> list[Frame]:
        """STOP frames that are due."""
        if not self._stops:
            return []
        due = [stamp for stamp in self._stops if stamp <= now_ns]
        self._stops = self._stops[len(due) :]
        return [] if self._config.listen_only else [self._wire.encode("STOP", {}) for _ in due]

    # Towards the device

    def veto(self, now_ns: int) -> HoldReason:
        """What forbids ACT now for reasons outside the gate; NONE when the device would take one."""
        if self.stopped or (self.device is not None and self.device.state == "EStop"):
            return HoldReason.STOPPED
        if self.device is not None and self.device.state in _FAULTS:
            return HoldReason.DEVICE_FAULT
        if self.device is None or self._status.expired(now_ns):
            return HoldReason.DEVICE_SILENT
        if self._config.listen_only:
            return HoldReason.LISTEN_ONLY
        if not self.session.armed:
            return HoldReason.NOT_ARMED
        if self.device.state in _UNREADY:
            return HoldReason.DEVICE_NOT_READY
        return HoldReason.OVERRUN if self.overrun else HoldReason.NONE

    def begin_tick(self, now_ns: int) -> None:
        """Call first in every tick, before `veto`: notices that the last one is too long ago, and a silent device."""
        late_ns = 0 if self._last_tick_ns is None else now_ns - self._last_tick_ns - TICK_NS
        self.overrun = late_ns >= OVERRUN_NS - TICK_NS
        self._last_tick_ns = now_ns
        self.diag["Overruns"] += self.overrun
        self.diag["TickLateMaxUs"] = max(self.diag["TickLateMaxUs"], late_ns // 1000)
        if self.device is not None and self._status.expired(now_ns):
            self.diag["StatusSilences"] += self.session.armed
            self.session.drop("device silent")

    def tick(
        self,
        decision: GateDecision | None,
        oldest_input_ns: int | None,
        valid: tuple[bool, bool, bool],
        bundle_id: int,
        now_ns: int,
    ) -> list[Frame]:
        """The frames of one 25 Hz tick, ACT_CMD first. A decision against a veto is sent as HOLD.

        decision: the gate's; None is HOLD for want of an estimate. oldest_input_ns: stamp of the newest feature
        vector's oldest input, None when there is none. valid: one flag per modality. bundle_id: 16 bits.
        """
        age_ms = sensing_age_ms(oldest_input_ns, now_ns)
        action, verb, reason = sendable(decision, self.veto(now_ns), age_ms, self.command, self._config.vocabulary)
        self.command = Command(action, verb, reason, now_ns)
        self.diag["Acts" if action is Action.ACT else "Holds"] += 1
        if self._config.listen_only:
            return []
        act_cmd = self._wire.encode(
            "ACT_CMD",
            {
                "Gate": "Act" if action is Action.ACT else "Hold",
                "Verb": verb,
                "Confidence": 0 if decision is None else round(100 * min(max(decision.confidence, 0.0), 1.0)),
                "Session": self.session.number,
                "Echo": 0 if self.device is None else self.device.counter,
                "SensingAge": age_ms,
            },
        )
        frames = [act_cmd]
        if action is Action.ACT:
            authorisation = self.session.authorise(act_cmd.data)
            if authorisation is not None:
                frames.append(self._wire.encode("ACT_AUTH", authorisation))
        if now_ns >= self._heartbeat_due_ns:
            self._heartbeat_due_ns = now_ns + HEARTBEAT_NS - TICK_NS
            frames.append(self._heartbeat(valid, bundle_id))
        frames += self._handshake(now_ns)
        frames.append(self._diagnosis())
        return frames

    def _heartbeat(self, valid: tuple[bool, bool, bool], bundle_id: int) -> Frame:
        state = BridgeState.RUNNING if self.device is not None else BridgeState.STARTING
        return self._wire.encode(
            "BRIDGE_HB",
            {
                "SensorValid": sum(1 << bit for bit, ok in enumerate(valid) if ok),
                "BridgeState": state.value,
                "Overruns": self.diag["Overruns"] & 0xFF,
                "BundleId": bundle_id & 0xFFFF,
                "ProtocolVersion": PROTOCOL_VERSION,
            },
        )

    def _handshake(self, now_ns: int) -> list[Frame]:
        """An ARM_REQUEST when one is wanted, possible and due."""
        if self.device is None or not self.session.may_request(now_ns):
            return []
        latched = self.device.state in ("Latched", "EStop")
        if self._clear_wanted and latched:
            # Again and again: the first request of a bridge started anew may be taken for a repetition.
            self._clear_asked = True
            return self._sendable("ARM_REQUEST", self.session.request(Purpose.CLEAR_LATCH, self._nonce(), now_ns))
        if self._clear_asked:  # and answered: what was to be cleared is no more
            self._clear_wanted = self._clear_asked = False
        if self._config.arm and self.device.state in ("Follow", "Ready"):
            return self._sendable("ARM_REQUEST", self.session.request(Purpose.ARM, self._nonce(), now_ns))
        return []

    def _sendable(self, message: str, signals: Mapping[str, Value]) -> list[Frame]:
        return [] if self._config.listen_only else [self._wire.encode(message, signals)]

    def _diagnosis(self) -> Frame:
        """One counter per tick: all of them within the second. Which there are is looked up at the start of a round."""
        self.diag["SessionsDropped"] = self.session.dropped
        counters = self._counters()
        if self._diag_index >= len(self._diag_names):
            self._diag_names, self._diag_index = sorted({*counters, *self.diag}), 0
        name = self._diag_names[self._diag_index]
        self._diag_index += 1
        value = self.diag[name] if name in self.diag else counters.get(name, 0)
        return self._wire.encode("BRIDGE_DIAG", {"Index": name, name: min(value, 0xFFFFFFFF)})
