"""Arming while somebody else asks too: never blamed on the key, tried with growing pauses."""

from __future__ import annotations

import pytest

from hilbridge.core.session import Phase, Purpose
from hilbridge.limits import MS
from tests.core.test_session import fresh

requirement = pytest.mark.requirement


@requirement("P6")
@pytest.mark.parametrize(("gap_ms", "answered"), [(0, False), (50, False), (51, True)])
def test_a_challenge_soon_after_a_strangers_request_is_not_answered(gap_ms: int, answered: bool) -> None:
    session = fresh()
    session.on_stranger("ARM_REQUEST", 10 * MS)
    session.request(Purpose.ARM, 1, 10 * MS)
    assert (session.on_challenge(1, 3, (10 + gap_ms) * MS) is not None) == answered
    assert session.disturbed == int(not answered)
    if not answered:
        assert session.phase is Phase.IDLE
        assert session.on_challenge(2, 4, (100 + gap_ms) * MS) is None  # nobody has asked again yet


@requirement("P6")
def test_pauses_after_disturbed_handshakes_grow_to_their_limit_and_shrink_with_a_session() -> None:
    session, now_ns, pauses = fresh(), 0, []

    def pause() -> int:
        session.on_stranger("ARM_REQUEST", now_ns)
        session.request(Purpose.ARM, 1, now_ns)
        assert session.on_challenge(1, 3, now_ns) is None
        return next(ms for ms in range(1, 5000) if session.may_request(now_ns + ms * MS))

    for _ in range(5):
        pauses.append(pause())
        now_ns += pauses[-1] * MS
    assert pauses == [300, 600, 1200, 1200, 1200]
    now_ns += 100 * MS
    session.request(Purpose.ARM, 1, now_ns)
    session.on_challenge(1, 3, now_ns)
    session.on_status(True, 3)
    assert session.armed
    session.drop("test")
    assert pause() == 300


@requirement("P6")
@pytest.mark.parametrize(
    ("strange", "failures", "refused"),
    [(0, 1, True), (1, 1, False), (1, 2, True), (2, 2, False), (2, 1, False), (3, 2, False)],
)
def test_failures_that_others_were_heard_to_cause_are_not_ours(strange: int, failures: int, refused: bool) -> None:
    session = fresh()
    session.request(Purpose.ARM, 1, 0)
    session.on_challenge(1, 3, 0)
    for _ in range(strange):
        session.on_stranger("ARM_RESPONSE", 0)
    session.on_stranger("ACT_CMD", 0)
    session.on_mac_failures(failures)
    assert session.refused is refused


@requirement("P6")
def test_each_strange_response_explains_one_failure_once() -> None:
    session = fresh()
    session.request(Purpose.ARM, 1, 0)
    session.on_challenge(1, 3, 0)
    session.on_stranger("ARM_RESPONSE", 0)
    session.on_mac_failures(1)
    session.on_mac_failures(1)
    assert not session.refused
    session.on_mac_failures(2)
    assert session.refused


@requirement("P6")
@pytest.mark.parametrize("since", ["a session", "another boot"])
def test_strange_responses_of_before_explain_nothing(since: str) -> None:
    session = fresh()
    session.on_stranger("ARM_RESPONSE", 0)
    if since == "another boot":
        session.on_heartbeat(6)
        session.on_mac_failures(0)
    else:
        session.request(Purpose.ARM, 1, 0)
        session.on_challenge(1, 3, 0)
        session.on_status(True, 3)
        session.drop("test")
    session.request(Purpose.ARM, 2, 0)
    session.on_challenge(2, 4, 0)
    session.on_mac_failures(1)
    assert session.refused


@requirement("P6")
def test_an_answer_that_nothing_comes_of_is_a_disturbed_handshake_once() -> None:
    session = fresh()
    assert session.disturbed == 0
    session.request(Purpose.ARM, 1, 0)
    session.request(Purpose.ARM, 1, 300 * MS)  # only lost
    assert session.disturbed == 0
    session.on_challenge(1, 3, 301 * MS)
    session.request(Purpose.ARM, 1, 1_600 * MS)
    assert session.disturbed == 1
    session.on_challenge(1, 4, 1_601 * MS)
    session.request(Purpose.ARM, 1, 3_000 * MS)
    assert session.disturbed == 2


@requirement("P6")
@pytest.mark.parametrize(("before", "after", "refused"), [(2, 3, False), (2, 4, True), (5, 7, True)])
def test_what_a_stranger_explains_counts_from_what_was_known(before: int, after: int, refused: bool) -> None:
    session = fresh()
    session.on_mac_failures(before)
    session.request(Purpose.ARM, 1, 0)
    session.on_challenge(1, 3, 0)
    session.on_stranger("ARM_RESPONSE", 0)
    session.on_mac_failures(after)
    assert session.refused is refused
    if not refused:
        session.on_stranger("ARM_RESPONSE", 0)
        session.on_stranger("ARM_RESPONSE", 0)
        session.on_mac_failures(after + 2)
        session.on_mac_failures(after + 2)
        assert not session.refused
        session.on_mac_failures(after + 3)
        assert session.refused
