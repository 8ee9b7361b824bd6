from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.core.bridge import Command, sendable, sensing_age_ms
from hilbridge.core.session import Phase
from hilbridge.limits import MS
from hilbridge.records import Action, GateDecision, HoldReason
from hilbridge.verbs import DEFAULT, VERBS
from hilbridge.wire.keys import DEMO_KEY
from hilbridge.wire.secoc import Authenticator
from tests.core.hub import VALID, Hub
from tests.safety.rig import ACT_POUR, ACT_PUT, ACT_TAKE, HOLD

requirement = pytest.mark.requirement


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
    assert [DEFAULT.wire_name(index) for index in range(20)] == list(VERBS[:20])
    assert (DEFAULT.wire_name(20), DEFAULT.wire_name(None)) == ("Other", "None")


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


def test_a_bridge_begins_holding_with_nothing_known_nothing_asked_and_no_stop() -> None:
    hub = Hub()
    assert hub.bridge.command == Command(Action.HOLD, "None", HoldReason.NO_ESTIMATE, 0)
    assert not hub.bridge.stopped
    hub.heartbeat()
    assert "ARM_REQUEST" not in hub.tick(state="Latched")  # nobody has wished to clear it
    late = Hub()
    late.bridge.session.phase = Phase.ARMED
    late.status("Ready")
    assert late.bridge.veto(late.now_ns) is HoldReason.NONE  # no tick yet, so none that came late


def test_the_first_tick_has_a_heartbeat_whenever_it_comes_and_the_next_once_it_is_due() -> None:
    hub = Hub()
    hub.now_ns = 0
    assert "BRIDGE_HB" in hub.tick(after_ms=0)
    assert "BRIDGE_HB" not in hub.tick(after_ms=59)
    assert "BRIDGE_HB" in hub.tick(after_ms=1)


def test_an_input_of_this_very_moment_has_no_age() -> None:
    assert sensing_age_ms(5, 5) == 0


def test_heartbeats_carry_the_low_bits_of_overruns_and_bundle() -> None:
    hub = Hub()
    for overruns, shown in ((255, 255), (0x1FF, 255), (256, 0)):
        hub.bridge.diag["Overruns"] = overruns
        frames = hub.bridge.tick(HOLD, None, VALID, 0x7FFFF, hub.now_ns)
        beat = hub.read(frames)["BRIDGE_HB"]
        assert (beat["Overruns"], beat["BundleId"], beat["ProtocolVersion"]) == (shown, 0xFFFF, 1)
        hub.now_ns += 100 * MS


def test_acts_and_holds_are_counted_as_sent() -> None:
    hub = Hub().arm()
    before = dict(hub.bridge.diag)
    hub.tick(ACT_TAKE)
    hub.tick(ACT_TAKE)
    hub.tick(HOLD)
    assert hub.bridge.diag["Acts"] - before["Acts"] == 2
    assert hub.bridge.diag["Holds"] - before["Holds"] == 1


def test_an_act_that_cannot_be_authorised_goes_out_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    hub = Hub().arm()
    monkeypatch.setattr(hub.bridge.session, "authorise", lambda act_cmd: None)
    sent = hub.tick(ACT_TAKE)
    assert sent["ACT_CMD"]["Gate"] == "Act"
    assert "ACT_AUTH" not in sent


@requirement("W9")
def test_an_act_that_names_no_verb_that_may_be_assisted_is_a_hold() -> None:
    before = Command(Action.HOLD, "None", HoldReason.NO_ESTIMATE, 0)
    for index in (None, *sorted(DEFAULT.never_assisted)):
        act = GateDecision(Action.ACT, index, 0.9, HoldReason.NONE)
        assert sendable(act, HoldReason.NONE, 0, before) == (Action.HOLD, "None", HoldReason.VERB_NOT_ASSISTED)
    take = GateDecision(Action.ACT, VERBS.index("Take"), 0.9, HoldReason.NONE)
    assert sendable(take, HoldReason.NONE, 0, before) == (Action.ACT, "Take", HoldReason.NONE)


def test_stops_are_to_come_until_the_last_of_them_is_sent() -> None:
    hub = Hub().arm()
    assert hub.bridge.is_stopping is False
    hub.bridge.request_stop(hub.now_ns)
    hub.bridge.poll(hub.now_ns + 19 * MS)
    assert hub.bridge.is_stopping is True
    hub.bridge.poll(hub.now_ns + 20 * MS)
    assert hub.bridge.is_stopping is False
