"""The bridge's half of the protocol, one rule at a time, and with the real device on a perfect bus."""

from __future__ import annotations

import itertools
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_sim import frames as device_frames
from firmware_sim.memory import Received
from firmware_sim.states import Reason, State
from hilbridge.core import session as session_module
from hilbridge.core.bridge import Bridge, BridgeConfig, sensing_age_ms, verb_name
from hilbridge.core.deadline import Deadline
from hilbridge.core.session import Phase, Purpose, Session
from hilbridge.limits import MS
from hilbridge.records import Action, Frame, GateDecision, HoldReason
from hilbridge.verbs import VERBS
from hilbridge.wire.codec import Decoded
from hilbridge.wire.keys import DEMO_KEY
from hilbridge.wire.link import WireLink
from hilbridge.wire.secoc import Authenticator
from tests.safety.rig import ACT_POUR, ACT_PUT, ACT_TAKE, HOLD, Rig, codec

requirement = pytest.mark.requirement
VALID = (True, True, True)


@requirement("W9")
def test_deadline_expires_at_its_limit_and_before_it_was_ever_fed() -> None:
    deadline = Deadline(60)
    assert deadline.expired(0)
    deadline = deadline.fed(100)
    assert not deadline.expired(159)
    assert deadline.expired(160)
    assert deadline.limit_ns == 60


class Hub:
    """A bridge alone, with a device whose messages are made by hand."""

    def __init__(self, **config: bool) -> None:
        self.wire = WireLink(codec())
        self.nonces = iter(range(1000, 2000))
        self.bridge = Bridge(
            self.wire,
            Authenticator(DEMO_KEY),
            lambda: next(self.nonces),
            BridgeConfig(**config),
            lambda: self.wire.counters,
        )
        self.now_ns = 1_000 * MS
        self.counter = 0

    def status(self, state: str = "Ready", **signals: Any) -> list[Frame]:
        self.counter = (self.counter + 1) & 0xFF
        full = {
            "State": state,
            "Reason": "None",
            "AppliedVerb": "None",
            "Authority": 0,
            "AcceptedCounter": 0,
            "Session": self.bridge.session.number,
            "Armed": int(self.bridge.session.armed),
            "AssistZero": 1,
        }
        return self.bridge.on_message("CTRL_STATUS", full | signals, self.counter, self.now_ns)

    def heartbeat(self, nonce: int = 5, version: int = 1) -> None:
        self.bridge.on_message("CTRL_HB", {"ProtocolVersion": version, "BootNonce": nonce}, 1, self.now_ns)
        self.bridge.on_message("CTRL_DIAG", {"Index": "MacFailures", "MacFailures": 0}, 1, self.now_ns)

    def tick(
        self,
        decision: GateDecision | None = HOLD,
        *,
        after_ms: int = 40,
        age_ms: int | None = 20,
        state: str | None = "Ready",
    ) -> dict[str, dict[str, Any]]:
        """Time, a status, a tick; returns what was sent by message name."""
        self.now_ns += after_ms * MS
        if state is not None:
            self.status(state)
        self.bridge.begin_tick(self.now_ns)
        oldest = None if age_ms is None else self.now_ns - age_ms * MS
        return self.read(self.bridge.tick(decision, oldest, VALID, 0x1234, self.now_ns))

    def read(self, sent: list[Frame]) -> dict[str, dict[str, Any]]:
        found = {}
        for frame in sent:
            decoded = codec().decode(frame)
            assert isinstance(decoded, Decoded)
            found[decoded.name] = dict(decoded.signals)
        return found

    def arm(self, number: int = 9) -> Hub:
        self.heartbeat()
        request = self.tick(state="Follow")["ARM_REQUEST"]
        assert request["Purpose"] == "Arm"
        answer = self.bridge.on_message("ARM_CHALLENGE", {"DeviceNonce": 77, "Session": number}, 1, self.now_ns)
        assert [frame.can_id for frame in answer] == [0x182]
        self.status("Follow", Session=number, Armed=1)
        assert self.bridge.session.armed
        return self


@requirement("W9", "P5")
def test_every_veto_has_its_name_in_this_order() -> None:
    hub = Hub()
    veto = hub.bridge.veto
    assert veto(hub.now_ns) is HoldReason.DEVICE_SILENT
    hub.status("Follow")
    assert veto(hub.now_ns) is HoldReason.NOT_ARMED
    hub.arm()
    for state in ("Boot", "SelfTest", "Follow", "RampDown"):
        hub.status(state)
        assert veto(hub.now_ns) is HoldReason.DEVICE_NOT_READY
    for state in ("Ready", "Assist"):
        hub.status(state)
        assert veto(hub.now_ns) is HoldReason.NONE
    for state in ("Passive", "Latched"):
        hub.status(state)
        assert veto(hub.now_ns) is HoldReason.DEVICE_FAULT
    hub.status("EStop")
    assert veto(hub.now_ns) is HoldReason.STOPPED
    hub.status("Ready")
    assert veto(hub.now_ns + 59 * MS) is HoldReason.NONE
    assert veto(hub.now_ns + 60 * MS) is HoldReason.DEVICE_SILENT
    listening = Hub(listen_only=True)
    listening.status("Ready")
    assert listening.bridge.veto(listening.now_ns) is HoldReason.LISTEN_ONLY


@requirement("W9")
def test_h9_a_silent_device_means_hold_and_the_session_is_dropped() -> None:
    hub = Hub().arm()
    assert hub.tick(ACT_TAKE)["ACT_CMD"]["Gate"] == "Act"
    sent = hub.tick(ACT_TAKE, state=None, after_ms=59)  # 59 ms of silence are allowed
    assert sent["ACT_CMD"]["Gate"] == "Act"
    sent = hub.tick(ACT_TAKE, state=None, after_ms=1)
    assert sent["ACT_CMD"]["Gate"] == "Hold"
    assert sent["ACT_CMD"]["Session"] == 0
    assert hub.bridge.command.reason is HoldReason.DEVICE_SILENT
    assert hub.bridge.session.dropped == 1
    assert hub.bridge.session.why == "device silent"
    assert hub.bridge.diag["StatusSilences"] == 1
    hub.tick(state=None)
    assert hub.bridge.diag["StatusSilences"] == 1


@requirement("W10")
def test_h9_an_overrun_of_the_tick_is_hold_that_tick_and_counted() -> None:
    hub = Hub().arm()
    assert hub.tick(ACT_TAKE)["ACT_CMD"]["Gate"] == "Act"
    hub.tick(ACT_TAKE, after_ms=79)
    assert hub.bridge.diag["Overruns"] == 0
    assert hub.bridge.diag["TickLateMaxUs"] == 39_000
    sent = hub.tick(ACT_TAKE, after_ms=80)
    assert sent["ACT_CMD"]["Gate"] == "Hold"
    assert hub.bridge.command.reason is HoldReason.OVERRUN
    assert hub.bridge.diag["Overruns"] == 1
    assert hub.tick(ACT_TAKE)["ACT_CMD"]["Gate"] == "Act"
    assert hub.bridge.diag["Overruns"] == 1


@requirement("P5", "P7")
def test_an_act_carries_session_echo_age_and_its_authorisation_right_behind() -> None:
    hub = Hub().arm(number=9)
    hub.now_ns += 40 * MS
    hub.status("Ready")
    hub.bridge.begin_tick(hub.now_ns)
    sent = hub.bridge.tick(ACT_POUR, hub.now_ns - 33 * MS, VALID, 7, hub.now_ns)
    assert [frame.can_id for frame in sent][:2] == [0x060, 0x061]
    signals = hub.read(sent)["ACT_CMD"]
    assert signals == {
        "Gate": "Act",
        "Verb": "Pour",
        "Confidence": 90,
        "Session": 9,
        "Echo": hub.counter,
        "SensingAge": 34,
    }
    key = Authenticator(DEMO_KEY).session_key(1000, 77, 5, 9)
    assert hub.read(sent)["ACT_AUTH"] == {
        "Freshness": 1,
        "Mac": Authenticator(DEMO_KEY).act_mac(key, 9, 1, sent[0].data),
    }
    assert hub.bridge.diag["Acts"] == 1
    assert hub.tick(ACT_POUR)["ACT_AUTH"]["Freshness"] == 2
    assert "ACT_AUTH" not in hub.tick(HOLD)
    assert hub.bridge.diag["Holds"] == 2  # while arming, and now


@requirement("W4")
@pytest.mark.parametrize(
    ("age_ms", "gate", "on_wire"), [(150, "Act", 150), (151, "Hold", 152), (900, "Hold", 510), (None, "Hold", 510)]
)
def test_h8_the_bridge_holds_on_stale_sensing_by_itself(age_ms: int | None, gate: str, on_wire: int) -> None:
    hub = Hub().arm()
    sent = hub.tick(ACT_TAKE, age_ms=age_ms)["ACT_CMD"]
    assert (sent["Gate"], sent["SensingAge"]) == (gate, on_wire)
    assert hub.bridge.command.reason is (HoldReason.NONE if gate == "Act" else HoldReason.STALE)


@given(st.integers(0, 10**10), st.integers(0, 10**10))
def test_sensing_age_is_never_understated(oldest_ns: int, now_ns: int) -> None:
    age_ms = sensing_age_ms(oldest_ns, now_ns)
    assert age_ms % 2 == 0
    if oldest_ns > now_ns:
        assert age_ms == 510
    else:
        assert age_ms == 510 or 0 <= age_ms * MS - (now_ns - oldest_ns) < 2 * MS
        assert age_ms <= 510


@requirement("S4")
def test_h7_a_change_of_verb_is_sent_as_hold_once() -> None:
    hub = Hub().arm()
    hub.tick(ACT_TAKE)
    sent = hub.tick(ACT_PUT)
    assert sent["ACT_CMD"]["Gate"] == "Hold"
    assert sent["ACT_CMD"]["Verb"] == "None"
    assert hub.bridge.command.reason is HoldReason.VERB_CHANGE
    assert hub.tick(ACT_PUT)["ACT_CMD"]["Verb"] == "Put"


def test_holds_keep_the_gates_reason_and_confidence() -> None:
    hub = Hub().arm()
    sent = hub.tick(GateDecision(Action.HOLD, None, 0.456, HoldReason.REFRACTORY))["ACT_CMD"]
    assert (sent["Gate"], sent["Verb"], sent["Confidence"]) == ("Hold", "None", 46)
    assert hub.bridge.command.reason is HoldReason.REFRACTORY
    assert hub.tick(None)["ACT_CMD"]["Confidence"] == 0
    assert hub.bridge.command.reason is HoldReason.NO_ESTIMATE
    assert hub.tick(GateDecision(Action.ACT, 0, 1.7, HoldReason.NONE))["ACT_CMD"]["Confidence"] == 100
    hub.status("Latched")
    assert hub.tick(None, state="Latched")["ACT_CMD"]["Gate"] == "Hold"
    assert hub.bridge.command.reason is HoldReason.DEVICE_FAULT


def test_verbs_have_their_names_on_the_wire() -> None:
    assert [verb_name(index) for index in range(20)] == list(VERBS[:20])
    assert (verb_name(20), verb_name(None)) == ("Other", "None")


@requirement("P11")
def test_heartbeats_and_diagnosis_come_in_their_cycle() -> None:
    hub = Hub().arm()
    beats, names = [], set()
    for tick in range(50):
        sent = hub.tick()
        if "BRIDGE_HB" in sent:
            beats.append(tick * 40)
            assert sent["BRIDGE_HB"] == {
                "SensorValid": 7,
                "BridgeState": "Running",
                "Overruns": 0,
                "BundleId": 0x1234,
                "ProtocolVersion": 1,
            }
        if tick < 25:
            names.add(sent["BRIDGE_DIAG"]["Index"])
    assert len(names) == 22  # each counter within the second
    gaps = {b - a for a, b in itertools.pairwise(beats)}
    assert gaps == {80}  # at most 100 ms apart: two lost ones do not disarm (250 ms)


def test_heartbeat_says_which_sensors_are_there_and_that_no_device_is() -> None:
    hub = Hub()
    hub.bridge.begin_tick(hub.now_ns)
    sent = hub.read(hub.bridge.tick(None, None, (True, False, True), 7, hub.now_ns))
    assert sent["BRIDGE_HB"]["SensorValid"] == 0b101
    assert sent["BRIDGE_HB"]["BridgeState"] == "Starting"
    assert "ARM_REQUEST" not in sent
    assert sent["ACT_CMD"]["Echo"] == 0


@requirement("P12")
def test_listen_only_sends_nothing_at_all() -> None:
    hub = Hub(listen_only=True)
    hub.heartbeat()
    hub.status("Follow")
    assert hub.tick(ACT_TAKE) == {}
    assert hub.bridge.request_stop(hub.now_ns) == []
    assert hub.bridge.poll(hub.now_ns + 10**9) == []
    hub.bridge.session.request(Purpose.ARM, 1, hub.now_ns)
    assert hub.bridge.on_message("ARM_CHALLENGE", {"DeviceNonce": 7, "Session": 1}, 1, hub.now_ns) == []
    assert hub.bridge.command.reason is HoldReason.LISTEN_ONLY


@requirement("P12")
def test_without_arming_nothing_is_asked_for() -> None:
    hub = Hub(arm=False)
    hub.heartbeat()
    for _ in range(20):
        assert "ARM_REQUEST" not in hub.tick(state="Follow")


@requirement("P3")
def test_stop_goes_out_three_times_at_ten_milliseconds() -> None:
    hub = Hub().arm()
    sent = {0: len(hub.bridge.request_stop(hub.now_ns))}
    for ms in range(1, 50):
        sent[ms] = len(hub.bridge.poll(hub.now_ns + ms * MS))
    assert {ms: n for ms, n in sent.items() if n} == {0: 1, 10: 1, 20: 1}
    assert hub.bridge.stopped
    assert not hub.bridge.session.armed
    assert hub.tick(ACT_TAKE)["ACT_CMD"]["Gate"] == "Hold"
    assert hub.bridge.command.reason is HoldReason.STOPPED


@requirement("P3")
def test_a_stop_of_another_node_stops_until_it_is_cleared_at_the_device() -> None:
    hub = Hub().arm()
    hub.bridge.on_message("STOP", {}, 0, hub.now_ns)
    assert hub.bridge.stopped
    assert not hub.bridge.session.armed
    hub.status("Follow")
    assert hub.bridge.stopped
    hub.status("EStop")
    assert hub.bridge.stopped
    hub.status("SelfTest")
    assert not hub.bridge.stopped


@requirement("S7")
def test_clearing_a_latch_is_authenticated_until_cleared_and_leaves_no_session() -> None:
    hub = Hub()
    hub.heartbeat()
    hub.bridge.request_clear_latch()
    assert "ARM_REQUEST" not in hub.tick(state="Passive")
    sent = hub.tick(state="Latched")
    assert sent["ARM_REQUEST"]["Purpose"] == "ClearLatch"
    answer = hub.bridge.on_message("ARM_CHALLENGE", {"DeviceNonce": 3, "Session": 4}, 1, hub.now_ns)
    mac = hub.read(answer)["ARM_RESPONSE"]["Mac"]
    crypto = Authenticator(DEMO_KEY)
    key = crypto.session_key(1000, 3, 5, 4)
    assert mac == crypto.arm_mac(key, "ClearLatch", 4, 1000, 3)
    hub.status("Latched", Armed=1, Session=4)
    assert not hub.bridge.session.armed
    # A device that took the response of a bridge started anew for a repetition is asked again, but not at once.
    assert "ARM_REQUEST" not in hub.tick(state="Latched")
    hub.now_ns += 2_000 * MS
    assert hub.tick(state="Latched", after_ms=0)["ARM_REQUEST"]["Purpose"] == "ClearLatch"
    hub.now_ns += 2_000 * MS
    assert hub.tick(state="Follow", after_ms=0)["ARM_REQUEST"]["Purpose"] == "Arm"
    hub.now_ns += 2_000 * MS
    assert "ARM_REQUEST" not in hub.tick(state="Latched", after_ms=0)


@requirement("P6")
@pytest.mark.parametrize("bus_down", [True, False])
def test_h2_a_frame_that_did_not_go_out_ends_the_session(bus_down: bool) -> None:
    hub = Hub().arm()
    hub.bridge.on_send_failed(bus_down)
    assert not hub.bridge.session.armed
    assert hub.bridge.diag["TxBusDown" if bus_down else "TxQueueFull"] == 1
    assert hub.bridge.session.why == ("bus down" if bus_down else "transmit queue full")
    assert hub.tick(ACT_TAKE)["ACT_CMD"]["Gate"] == "Hold"


@requirement("P6")
def test_bus_off_ends_the_session_and_warnings_do_not() -> None:
    hub = Hub().arm()
    hub.bridge.on_bus_state(2, bus_off=False)
    assert hub.bridge.session.armed
    assert hub.bridge.diag["BusState"] == 2
    hub.bridge.on_bus_state(4, bus_off=True)
    assert not hub.bridge.session.armed
    assert hub.bridge.session.why == "bus-off"


def test_emergencies_and_device_counters_are_kept() -> None:
    hub = Hub()
    signals = {"Code": "TickOverrun", "State": "Latched", "Latched": 1, "Count": 3}
    hub.bridge.on_message("CTRL_EMCY", signals, 1, 5)
    assert hub.bridge.emergencies == [(5, "TickOverrun", "Latched")]
    hub.bridge.on_message("CTRL_DIAG", {"Index": "RejCrc", "RejCrc": 12}, 1, 5)
    assert hub.bridge.device_diag == {"RejCrc": 12}
    assert hub.bridge.on_message("CTRL_MEAS", {}, 1, 5) == []


def test_diagnosis_shows_the_sessions_lost() -> None:
    hub = Hub().arm()
    hub.bridge.session.drop("test")
    seen = {}
    for _ in range(22):
        sent = hub.tick(state="Latched")["BRIDGE_DIAG"]
        seen[sent["Index"]] = sent[sent["Index"]]
    assert seen["SessionsDropped"] == 1
    hub.bridge.diag["Holds"] = 2**40
    for _ in range(22):
        sent = hub.tick(state="Latched")["BRIDGE_DIAG"]
        seen[sent["Index"]] = sent[sent["Index"]]
    assert seen["Holds"] == 0xFFFFFFFF


# Session


def fresh() -> Session:
    session = Session(Authenticator(DEMO_KEY))
    session.on_heartbeat(5)
    session.on_mac_failures(0)
    return session


@requirement("P6")
def test_nothing_is_asked_before_the_device_is_known() -> None:
    session = Session(Authenticator(DEMO_KEY))
    assert not session.may_request(0)
    session.request(Purpose.ARM, 1, 0)
    assert session.on_challenge(1, 1, 0) is None
    hub = Hub()
    hub.heartbeat(version=2)
    assert "ARM_REQUEST" not in hub.tick(state="Follow")


@requirement("P6")
def test_requests_are_repeated_at_300_ms_and_responses_confirmed_within_1200() -> None:
    session = fresh()
    assert session.may_request(0)
    assert session.request(Purpose.ARM, 11, 0) == {"BridgeNonce": 11, "Purpose": "Arm"}
    assert session.phase is Phase.REQUESTED
    assert not session.may_request(300 * MS - 1)
    assert session.may_request(300 * MS)
    assert session.on_challenge(1, 1, 100 * MS) is not None
    assert session.phase is Phase.RESPONDED
    assert not session.may_request(1_300 * MS - 1)
    assert session.may_request(1_300 * MS)


@requirement("P6")
def test_a_challenge_nobody_asked_for_is_not_answered() -> None:
    session = fresh()
    assert session.on_challenge(1, 1, 0) is None
    session.request(Purpose.ARM, 1, 0)
    assert session.on_challenge(1, 1, 0) is not None
    assert session.on_challenge(2, 2, 0) is None


@requirement("P6")
@pytest.mark.parametrize(("armed", "number", "confirmed"), [(True, 3, True), (False, 3, False), (True, 4, False)])
def test_only_the_offered_session_is_confirmed(armed: bool, number: int, confirmed: bool) -> None:
    session = fresh()
    session.request(Purpose.ARM, 1, 0)
    session.on_status(armed, number)
    assert not session.armed
    session.on_challenge(1, 3, 0)
    session.on_status(armed, number)
    assert session.armed == confirmed
    assert session.number == (3 if confirmed else 0)
    if confirmed:
        assert not session.may_request(10**18)


@requirement("P6")
@pytest.mark.parametrize(("armed", "number"), [(False, 3), (True, 4)])
def test_a_device_that_let_go_ends_the_session(armed: bool, number: int) -> None:
    session = fresh()
    session.request(Purpose.ARM, 1, 0)
    session.on_challenge(1, 3, 0)
    session.on_status(True, 3)
    session.on_status(True, 3)
    assert session.armed
    session.on_status(armed, number)
    assert session.phase is Phase.IDLE
    assert (session.number, session.dropped, session.why) == (0, 1, "device disarmed")
    assert session._key == b""  # no key outlives its session
    assert session.authorise(bytes(8)) is None
    assert session.may_request(0)


@requirement("P6")
def test_a_restarted_device_ends_the_session() -> None:
    session = fresh()
    session.request(Purpose.ARM, 1, 0)
    session.on_challenge(1, 3, 0)
    session.on_status(True, 3)
    session.on_heartbeat(5)
    assert session.armed
    session.refused = True
    session.on_heartbeat(6)
    assert not session.armed
    assert session.why == "device restarted"
    assert not session.refused


@requirement("P6")
def test_a_repeated_request_keeps_its_nonce_so_that_a_late_challenge_is_answered_rightly() -> None:
    session = fresh()
    session.request(Purpose.ARM, 11, 0)
    assert session.request(Purpose.ARM, 12, 300 * MS) == {"BridgeNonce": 11, "Purpose": "Arm"}
    late = session.on_challenge(1, 1, 310 * MS)
    once = fresh()
    once.request(Purpose.ARM, 11, 0)
    assert late == once.on_challenge(1, 1, 10 * MS)
    assert session.request(Purpose.CLEAR_LATCH, 13, 1_600 * MS)["BridgeNonce"] == 11
    session.request(Purpose.ARM, 14, 1_900 * MS)
    session.on_challenge(2, 2, 1_910 * MS)
    session.on_status(True, 2)
    assert session.armed
    session.drop("test")
    assert session.request(Purpose.ARM, 15, 2_000 * MS)["BridgeNonce"] == 15  # one nonce, at most one session


@requirement("P6")
@pytest.mark.parametrize("doubt", ["device silent", "device restarted"])
def test_a_challenge_to_a_dropped_request_is_answered_with_the_right_key(doubt: str) -> None:
    session = fresh()
    session.request(Purpose.ARM, 11, 0)
    if doubt == "device restarted":
        session.on_heartbeat(6)
        session.on_mac_failures(0)
    session.drop(doubt)
    session.request(Purpose.ARM, 12, 100 * MS)
    answer = session.on_challenge(1, 1, 110 * MS)
    crypto = Authenticator(DEMO_KEY)
    key = crypto.session_key(11, 1, 6 if doubt == "device restarted" else 5, 1)
    assert answer == {"Mac": crypto.arm_mac(key, "Arm", 1, 11, 1), "Session": 1}


@requirement("P6")
def test_nothing_is_asked_before_the_device_has_told_its_mac_failures() -> None:
    session = Session(Authenticator(DEMO_KEY))
    session.on_heartbeat(5)
    assert not session.may_request(10**18)
    session.on_mac_failures(1)  # of another bridge, or of this one before it was started anew
    assert session.may_request(0)
    session.request(Purpose.ARM, 1, 0)
    session.on_challenge(1, 3, 0)
    session.on_mac_failures(1)
    assert not session.refused
    session.on_status(True, 3)
    assert session.armed
    session.on_heartbeat(6)
    assert not session.may_request(10**18)


@requirement("P6")
@pytest.mark.parametrize(("before", "after", "refused"), [(2, 2, False), (2, 3, True), (0, 1, True)])
def test_failures_of_before_are_not_ours(before: int, after: int, refused: bool) -> None:
    session = fresh()
    session.on_mac_failures(before)
    session.request(Purpose.ARM, 1, 0)
    session.on_challenge(1, 3, 0)
    session.on_mac_failures(after)
    assert session.refused is refused


@requirement("P6")
def test_a_failure_told_between_two_tries_still_ends_them() -> None:
    session = fresh()
    session.request(Purpose.ARM, 1, 0)
    session.on_challenge(1, 3, 0)
    session.drop("device silent")
    session.on_mac_failures(1)
    assert not session.refused
    session.request(Purpose.ARM, 2, 2_000 * MS)
    session.on_challenge(2, 4, 2_000 * MS)
    session.on_mac_failures(1)
    assert session.refused


@requirement("P6")
def test_a_session_that_nobody_began_has_nothing() -> None:
    session = Session(Authenticator(DEMO_KEY))
    session.on_mac_failures(1)
    assert (session.phase, session.number, session.dropped, session.why) == (Phase.IDLE, 0, 0, "")
    assert session.refused is False
    assert not session.may_request(0)


@requirement("P6")
def test_a_restarted_device_tells_its_failures_anew() -> None:
    session = fresh()
    session.on_mac_failures(2)
    session.on_heartbeat(6)
    assert not session.may_request(10**18)
    session.on_mac_failures(0)
    assert session.may_request(0)
    session.request(Purpose.ARM, 1, 0)
    session.on_challenge(1, 3, 0)
    session.on_mac_failures(1)
    assert session.refused


@requirement("P6")
def test_what_a_restarted_device_counts_before_our_response_is_not_ours() -> None:
    session = fresh()
    session.request(Purpose.ARM, 1, 0)
    session.on_challenge(1, 3, 0)
    session.on_heartbeat(6)
    session.on_mac_failures(1)
    session.request(Purpose.ARM, 2, 2_000 * MS)
    session.on_challenge(2, 4, 2_000 * MS)
    session.on_mac_failures(1)
    assert not session.refused


@requirement("P6")
def test_what_another_bridge_fails_at_a_restarted_device_before_our_response_is_not_ours() -> None:
    session = fresh()
    session.request(Purpose.ARM, 1, 0)
    session.on_challenge(1, 3, 0)
    session.on_heartbeat(6)
    session.on_mac_failures(0)
    session.on_mac_failures(1)
    session.request(Purpose.ARM, 2, 2_000 * MS)
    session.on_challenge(2, 4, 2_000 * MS)
    session.on_mac_failures(1)
    assert not session.refused


@requirement("P6")
def test_failures_while_armed_are_anothers() -> None:
    session = fresh()
    session.request(Purpose.ARM, 1, 0)
    session.on_challenge(1, 3, 0)
    session.on_status(True, 3)
    session.on_mac_failures(2)
    session.drop("device silent")
    session.request(Purpose.ARM, 2, 2_000 * MS)
    session.on_challenge(2, 4, 2_000 * MS)
    session.on_mac_failures(2)
    assert not session.refused


@requirement("P6")
def test_wrong_keys_are_noticed_before_they_latch_the_device() -> None:
    session = fresh()
    session.on_mac_failures(3)
    assert not session.refused
    session.request(Purpose.ARM, 1, 0)
    session.on_challenge(1, 3, 0)
    session.on_mac_failures(0)
    assert not session.refused
    session.on_mac_failures(1)
    assert session.refused
    assert session.phase is Phase.IDLE
    assert not session.may_request(10**18)


@requirement("P6")
def test_freshness_grows_with_every_act_and_ends_the_session_before_it_wraps(monkeypatch: pytest.MonkeyPatch) -> None:
    session = fresh()
    assert session.authorise(bytes(8)) is None
    session.request(Purpose.ARM, 1, 0)
    session.on_challenge(1, 3, 0)
    session.on_status(True, 3)
    crypto = Authenticator(DEMO_KEY)
    key = crypto.session_key(1, 1, 5, 3)
    for k in range(1, 300):
        assert session.authorise(bytes(8)) == {"Freshness": k & 0xFF, "Mac": crypto.act_mac(key, 3, k, bytes(8))}
    monkeypatch.setattr(session_module, "FRESHNESS_LIMIT", 300)
    assert session.authorise(bytes(8)) is not None
    assert session.authorise(bytes(8)) is None
    assert session.why == "freshness used up"
    assert session_module.CHALLENGE_WAIT_NS == 300 * MS


def test_dropping_what_is_not_armed_is_not_a_loss() -> None:
    session = fresh()
    session.drop("nothing")
    assert (session.dropped, session.why) == (0, "")
    session.request(Purpose.ARM, 1, 0)
    session.drop("nothing")
    assert session.phase is Phase.IDLE
    assert session.may_request(0)


@requirement("P6")
def test_a_new_session_starts_its_freshness_anew() -> None:
    session = fresh()
    for nonce in (1, 2):
        session.request(Purpose.ARM, nonce, 0)
        session.on_challenge(1, nonce, 0)
        session.on_status(True, nonce)
        authorisation = session.authorise(bytes(8))
        assert authorisation is not None
        assert authorisation["Freshness"] == 1
        session.drop("again")


# Both ends on a perfect bus


@requirement("S2", "S3")
def test_the_two_ends_arm_hold_and_assist() -> None:
    rig = Rig().assisting()
    assert rig.state.armed
    assert rig.bridge.session.number == rig.state.session
    assert rig.bridge.veto(rig.now_ms * MS) is HoldReason.NONE
    assert rig.wire.counters["LostFrames"] == 0


@requirement("T1", "P13")
def test_h2_a_dead_bridge_leaves_no_assist() -> None:
    rig = Rig().assisting()
    rig.bridge_runs = False
    accepted_ms = rig.state.command_ms
    rig.milliseconds_until_zero()
    assert rig.now_ms - accepted_ms <= 150
    rig.run(5)
    assert rig.state.state == State.FOLLOW
    rig.bridge_runs, rig.decision = True, ACT_TAKE
    rig.run(2000)
    assert rig.state.state == State.ASSIST  # recovers alone, through neutral


@requirement("T2", "S4")
def test_h7_a_change_of_verb_with_both_ends() -> None:
    rig = Rig().assisting(ACT_TAKE)
    rig.decision = ACT_POUR
    rig.run(400)
    assert rig.state.state == State.ASSIST
    assert rig.state.verb == 10
    states = [name for _, name, _ in rig.history]
    first = states.index("ASSIST")
    assert "FOLLOW" not in states[first:]
    assert "RAMP_DOWN" in states[first:]


@requirement("P6")
def test_h1_a_bridge_with_another_key_gets_nothing_and_does_not_latch_the_device() -> None:
    rig = Rig(key=b"another key here")
    rig.decision = ACT_TAKE
    rig.run(6000)
    assert rig.state.state == State.FOLLOW
    assert rig.state.mac_failures == 1
    assert rig.bridge.session.refused
    assert all(assist == 0 for _, _, assist in rig.history)


@requirement("S7")
def test_the_whole_way_out_of_a_latch_with_both_ends() -> None:
    rig = Rig().assisting()
    rig.put(Received(device_frames.CTRL_HB, b""))
    rig.tick()
    assert rig.state.reason == Reason.OWN_ID_SEEN
    rig.run(1000)
    assert rig.state.state == State.LATCHED
    assert rig.bridge.veto(rig.now_ms * MS) is HoldReason.DEVICE_FAULT
    rig.bridge.request_clear_latch()
    rig.run(300)
    assert rig.state.clear_until_ms > rig.now_ms
    rig.tick(local_clear=True)
    rig.decision = HOLD
    rig.until("READY")


@requirement("P14")
def test_every_second_command_lost_still_assists() -> None:
    rig = Rig().assisting()
    lost = {"n": 0}

    def lossy(frame: Received) -> list[Received]:
        if frame.can_id in (device_frames.ACT_CMD, device_frames.ACT_AUTH):
            lost["n"] += frame.can_id == device_frames.ACT_CMD
            return [frame] if lost["n"] % 2 else []
        return [frame]

    rig.to_device = lossy
    rig.run(3000)
    assert rig.state.state == State.ASSIST
    assert {name for _, name, _ in rig.history[-2900:]} == {"ASSIST"}


def test_numbers_and_names_that_others_rely_on() -> None:
    assert session_module.FRESHNESS_LIMIT == 0xFFFFFFFF
    assert session_module.CONFIRM_WAIT_NS == 1_200 * MS
    assert [phase.value for phase in Phase] == ["idle", "requested", "responded", "armed"]
    assert [purpose.value for purpose in Purpose] == ["Arm", "ClearLatch"]
    assert fresh().why == ""
