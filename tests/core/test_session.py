from __future__ import annotations

import pytest

from hilbridge.core import session as session_module
from hilbridge.core.session import Phase, Purpose, Session
from hilbridge.limits import MS
from hilbridge.wire.keys import DEMO_KEY
from hilbridge.wire.secoc import Authenticator
from tests.core.hub import Hub

requirement = pytest.mark.requirement


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


def test_numbers_and_names_that_others_rely_on() -> None:
    assert session_module.FRESHNESS_LIMIT == 0xFFFFFFFF
    assert session_module.CONFIRM_WAIT_NS == 1_200 * MS
    assert [phase.value for phase in Phase] == ["idle", "requested", "responded", "armed"]
    assert [purpose.value for purpose in Purpose] == ["Arm", "ClearLatch"]
    assert fresh().why == ""
