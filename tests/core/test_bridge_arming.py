"""core.bridge: asking, clearing, stopping, and what ends a session."""

from __future__ import annotations

import pytest

from hilbridge.core.session import Purpose
from hilbridge.limits import MS
from hilbridge.records import HoldReason
from hilbridge.wire.keys import DEMO_KEY
from hilbridge.wire.secoc import Authenticator
from tests.core.hub import Hub
from tests.safety.rig import ACT_TAKE

requirement = pytest.mark.requirement


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


def test_a_challenge_that_nobody_asked_for_is_not_answered_on_the_bus() -> None:
    hub = Hub()
    assert hub.bridge.on_message("ARM_CHALLENGE", {"DeviceNonce": 77, "Session": 9}, 1, hub.now_ns) == []


def test_nothing_is_asked_for_on_any_other_counter_nor_before_a_status() -> None:
    hub = Hub()
    hub.bridge.on_message("CTRL_HB", {"ProtocolVersion": 1, "BootNonce": 5}, 1, hub.now_ns)
    hub.bridge.on_message("CTRL_DIAG", {"Index": "RejCrc", "RejCrc": 0}, 1, hub.now_ns)
    assert "ARM_REQUEST" not in hub.tick(state="Follow")
    silent = Hub()
    silent.heartbeat()
    assert "ARM_REQUEST" not in silent.tick(state=None)


@pytest.mark.parametrize("state", ["Follow", "Ready"])
def test_a_device_that_follows_or_is_ready_is_asked(state: str) -> None:
    hub = Hub()
    hub.heartbeat()
    assert hub.tick(state=state)["ARM_REQUEST"]["Purpose"] == "Arm"


def test_a_stop_is_cleared_like_a_latch() -> None:
    hub = Hub()
    hub.heartbeat()
    hub.bridge.request_clear_latch()
    assert hub.tick(state="EStop")["ARM_REQUEST"]["Purpose"] == "ClearLatch"


@pytest.mark.parametrize("own", [True, False])
def test_a_stop_says_why_the_session_ended_and_lasts_while_the_device_says_so(own: bool) -> None:
    hub = Hub().arm()
    if own:
        hub.bridge.request_stop(hub.now_ns)
    else:
        hub.bridge.on_message("STOP", {}, 0, hub.now_ns)
    assert hub.bridge.session.why == "stop"
    for _ in range(3):
        hub.status("EStop")
        assert hub.bridge.stopped
