import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.limits import MS
from hilbridge.monitor.state import Link, Thresholds, Watch
from hilbridge.monitor.words import NO_BRIDGE, NO_SENSING, OLD_SENSING, REASONS, SENSORS, STATES
from hilbridge.records import Frame
from tests.monitor.made import CODEC, Bus


@pytest.fixture
def bus():
    return Bus()


def test_an_assist_names_its_verb(bus):
    bus.run(400)
    bus.state, bus.reason, bus.verb, bus.confidence = "Assist", "Authorised", "Pour", 93
    view = bus.run(400)
    assert (view["state"]["word"], view["state"]["kind"], view["state"]["verb"]) == ("ASSIST", "assist", "Pour")
    assert view["confidence"]["now"] == 0.93
    assert view["verbs"]["top"] == [["Pour", 0.5]]
    assert view["device"]["assist_nm"] == 0.5
    assert [text for _, text in view["events"]] == ["ASSIST Pour: The assist is authorised."]


@pytest.mark.parametrize(("mask", "name"), [(0b110, "gaze"), (0b011, "scene"), (0b101, "hands")])
def test_a_dropout_is_the_reason_from_the_first_heartbeat_that_tells_it(bus, mask, name):
    bus.run(400)
    bus.sensors = mask
    view = bus.run(80)
    assert (view["state"]["reason"], view["state"]["cure"]) == SENSORS[name]
    assert view["sensors"]["valid"][name] is False
    assert view["state"]["for_s"] == 0.0
    assert bus.run(1000)["state"]["for_s"] == 1.0
    bus.sensors = 0b111
    assert bus.run(80)["sensors"]["valid"][name] is True
    assert [text for _, text in bus.watch.view(bus.now_ns)["events"]][:2] == [
        f"{name} {'are' if name == 'hands' else 'is'} used again",
        f"{name} {'are' if name == 'hands' else 'is'} not used",
    ]


def test_a_blink_is_no_event(bus):
    bus.run(400)
    bus.sensors = 0b110
    assert bus.run(240)["state"]["reason"] == SENSORS["gaze"].text
    bus.sensors = 0b111
    assert bus.run(400)["events"] == []


def test_a_bridge_that_does_without_all_is_said_to_lack_sensing(bus):
    bus.run(400)
    bus.sensors = 0
    assert bus.run(80)["state"]["reason"] == NO_SENSING.text


def test_old_sensing_is_a_reason(bus):
    bus.age_ms = 200
    assert bus.run(400)["state"]["reason"] == OLD_SENSING.text


def test_a_silent_bridge_is_named_and_nothing_old_is_shown(bus):
    bus.run(400)
    bus.bridge_runs = False
    view = bus.run(600)
    assert view["state"]["reason"] == NO_BRIDGE.text
    assert view["confidence"]["now"] is None
    assert view["sensors"] == {"valid": {"gaze": None, "hands": None, "scene": None}, "age_ms": None, "limit_ms": 150}


def test_a_silent_device_is_no_state_at_all(bus):
    bus.run(400)
    bus.device_runs = False
    view = bus.run(400)
    assert (view["state"]["word"], view["device"]) == ("NO DEVICE", {})


def test_a_link_that_is_down_hides_what_was_last_heard(bus):
    bus.run(400)
    bus.watch.set_link(Link(False, "vcan0 is down"))
    state = bus.watch.view(bus.now_ns)["state"]
    assert (state["word"], state["reason"]) == ("NO BUS", "The bus is not there. vcan0 is down")


def test_a_latch_names_what_latched_it_whatever_the_bridge_lacks(bus):
    bus.sensors, bus.state, bus.reason = 0, "Latched", "MacFailures"
    state = bus.run(400)["state"]
    assert (state["word"], state["kind"]) == ("LATCHED", "fault")
    assert (state["reason"], "--clear-latch" in state["cure"]) == (REASONS["MacFailures"].text, True)


def test_confidence_below_the_threshold_is_a_reason_only_where_the_threshold_is_known(bus):
    assert bus.run(400)["state"]["reason"] == REASONS["Hold"].text
    bus.watch.thresholds = Thresholds(0.9, 0.85)
    assert "below the threshold" in bus.run(40)["state"]["reason"]


def test_thirty_seconds_are_kept_and_no_more(bus):
    first = bus.run(31_000)
    then = bus.run(31_000)
    assert len(first["confidence"]["trace"]) == len(then["confidence"]["trace"])
    assert min(s for s, *_ in then["confidence"]["trace"]) >= -30.0
    assert 0.03 < then["bus"]["load"] < 0.1
    assert then["bus"]["frames_s"] == pytest.approx(137, abs=3)


def test_events_told_late_stand_where_they_belong(bus):
    for at_ms, text in ((10, "a"), (30, "c"), (20, "b")):
        bus.watch.tell(text, at_ms * MS)
    assert [text for _, text in bus.watch.view(30 * MS)["events"]] == ["c", "b", "a"]


def test_the_log_does_not_grow_without_end(bus):
    for step in range(300):
        bus.watch.tell(str(step), step)
    assert len(bus.watch.view(0)["events"]) == 100


def test_a_stop_of_three_frames_is_one_event(bus):
    for at_ms in (0, 10, 20, 500):
        bus.watch.take(Frame(1, b""), at_ms * MS)
    assert [text for _, text in bus.watch.view(500 * MS)["events"]] == ["STOP on the bus"] * 2


def test_damaged_frames_are_counted_and_change_nothing(bus):
    bus.run(400)
    bus.watch.take(Frame(0x0A0, bytes(8)), bus.now_ns)
    view = bus.watch.view(bus.now_ns)
    assert (view["state"]["word"], view["bus"]["rejected"]) == ("READY", {"RejCrc": 1})


def test_every_state_and_reason_of_the_dbc_has_words():
    status = {signal.name: signal for signal in CODEC.messages["CTRL_STATUS"].signals}
    assert set(status["State"].names.values()) == set(STATES)
    assert set(status["Reason"].names.values()) == set(REASONS)
    assert all(said.text.endswith(".") for said in REASONS.values())


@given(
    st.lists(
        st.tuples(st.integers(0, 0x7FF), st.binary(max_size=64), st.booleans(), st.integers(0, 10**9)), max_size=30
    )
)
def test_whatever_is_on_the_bus_a_view_can_be_made(frames):
    watch, now_ns = Watch(CODEC, 0), 0
    for can_id, data, odd, passed_ns in frames:
        now_ns += passed_ns
        watch.take(Frame(can_id, data, is_fd=odd, is_extended=odd), now_ns)
        json.dumps(watch.view(now_ns), allow_nan=False)
