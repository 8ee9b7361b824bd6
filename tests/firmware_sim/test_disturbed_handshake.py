"""A forged or flooded ARM_REQUEST delays arming while it lasts and no longer; a wrong key is still told apart (H1)."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_sim import e2e, frames
from firmware_sim.frames import Reject
from firmware_sim.memory import COUNT_MAC_FAILURES, Received, Refusal
from hilbridge.runtime.node import _arming
from tests.safety.hand import Hand
from tests.safety.rig import Rig

requirement = pytest.mark.requirement


def forged(counter: int) -> Received:
    data = frames.pack(frames.ARM_REQUEST, (0xF0000000 + counter, frames.PURPOSE_ARM))
    return Received(frames.ARM_REQUEST, e2e.protect(frames.ARM_REQUEST, data, counter & 0xFF))


def forged_response(mac: int, session: int, counter: int) -> Received:
    data = frames.pack(frames.ARM_RESPONSE, (mac, session))
    return Received(frames.ARM_RESPONSE, e2e.protect(frames.ARM_RESPONSE, data, counter & 0xFF))


def first_request_ms() -> int:
    rig = Rig()
    while not any(frame.can_id == frames.ARM_REQUEST for frame in rig.sent):
        rig.tick()
    return rig.now_ms


def unblamed(rig: Rig) -> bool:
    return not rig.bridge.session.refused and rig.state.counters[COUNT_MAC_FAILURES] == 0


@requirement("P6")
@pytest.mark.parametrize("heard", [True, False])
@pytest.mark.parametrize("offset_ms", range(-3, 4))
def test_one_forged_request_is_not_taken_for_a_wrong_key(offset_ms: int, heard: bool) -> None:
    rig, asked_ms = Rig(), first_request_ms()
    for _ in range(4000):
        if rig.now_ms == asked_ms + offset_ms:
            (rig.stranger if heard else rig.put)(forged(200))
        rig.tick()
    assert rig.bridge.session.armed
    assert unblamed(rig)


@requirement("P6")
@pytest.mark.parametrize("offset_ms", range(-3, 1))
@pytest.mark.parametrize("lost", ["by the bus", "as a repetition"])
def test_a_strangers_challenge_is_not_answered_when_the_bridges_own_request_was_lost(lost: str, offset_ms: int) -> None:
    rig, asked_ms = Rig(), first_request_ms()
    if lost == "by the bus":
        rig.to_device = lambda frame: (
            [] if frame.can_id == frames.ARM_REQUEST and frame.data[6] != 0xF0 and rig.now_ms <= asked_ms else [frame]
        )
    for _ in range(2000):
        if rig.now_ms == asked_ms + offset_ms:
            rig.stranger(forged(1 if lost == "as a repetition" else 200))
        rig.tick()
        assert not rig.bridge.session.refused
    assert rig.bridge.session.armed
    assert unblamed(rig)


@requirement("P6")
@pytest.mark.parametrize("heard", [True, False])
@pytest.mark.parametrize("every_ms", [1, 3, 10, 40, 170])
def test_a_flood_delays_arming_for_two_seconds_at_most_after_it_ends(every_ms: int, heard: bool) -> None:
    rig = Rig()
    for k in range(5000):
        if k % every_ms == 0:
            (rig.stranger if heard else rig.put)(forged(k // every_ms + 1))
        rig.tick()
    assert rig.state.state.name != "LATCHED"
    assert not rig.bridge.session.refused
    for _ in range(2000):
        rig.tick()
    assert rig.bridge.session.armed


@requirement("P6")
@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 2500), st.integers(0, 255)), min_size=1, max_size=60),
    st.sets(st.integers(1, 6), max_size=3),
)
def test_h1_whoever_asks_whatever_is_lost_it_is_armed_two_seconds_later_and_no_key_is_blamed(
    requests: list[tuple[int, int]], lost: set[int]
) -> None:
    rig, asked = Rig(), 0

    def losing(frame: Received) -> list[Received]:
        nonlocal asked
        if frame.can_id == frames.ARM_REQUEST and frame.data[6] != 0xF0:
            asked += 1
            return [] if asked in lost else [frame]
        return [frame]

    rig.to_device = losing
    at: dict[int, list[int]] = {}
    for now_ms, counter in requests:
        at.setdefault(now_ms, []).append(counter)
    for _ in range(2500):
        for counter in at.get(rig.now_ms, ()):
            rig.stranger(forged(counter))
        rig.tick()
    rig.to_device = lambda frame: [frame]
    for _ in range(2000):
        rig.tick()
    assert rig.bridge.session.armed
    assert unblamed(rig)


@requirement("P6")
@pytest.mark.parametrize("offset_ms", range(4))
def test_a_strangers_response_is_not_taken_for_our_wrong_key(offset_ms: int) -> None:
    rig, asked_ms = Rig(), first_request_ms()
    for _ in range(6000):
        if rig.now_ms == asked_ms + offset_ms:
            rig.stranger(forged_response(7, rig.state.last_session or 1, 9))
        rig.tick()
    assert not rig.bridge.session.refused
    assert rig.bridge.session.armed
    assert rig.state.counters[COUNT_MAC_FAILURES] <= 1  # the stranger's


@requirement("P6")
def test_h1_a_wrong_key_is_still_told_apart_and_both_ends_name_it() -> None:
    rig = Rig(key=b"another key here")
    rig.run(3000)
    assert rig.bridge.session.refused
    assert rig.state.refusal is Refusal.KEY
    assert "rejects our key" in _arming(rig.bridge.session)


@requirement("P6")
def test_a_disturbed_handshake_is_named_on_both_ends_and_tried_with_growing_pauses() -> None:
    rig, asked_ms = Rig(), []

    def disturb(frame: Received) -> list[Received]:
        if frame.can_id != frames.ARM_REQUEST:
            return [frame]
        asked_ms.append(rig.now_ms)
        stranger = forged(len(asked_ms) + 100)
        rig._bridge_hears(stranger, rig.now_ms * 1_000_000)
        return [frame, stranger]

    rig.to_device = disturb
    rig.run(8000)
    pauses = [after - before for before, after in itertools.pairwise(asked_ms)]
    assert pauses[:2] == [320, 600]
    assert set(pauses[2:]) == {1200}
    assert "handshakes disturbed, somebody else asks too" in _arming(rig.bridge.session)
    assert rig.bridge.session.disturbed == len(asked_ms)
    assert unblamed(rig)
    rig.to_device = lambda frame: [frame]
    assert rig.run(2000).bridge.session.armed


# At the device


def disturbed(hand: Hand, **broken: int) -> None:
    hand.to_follow()
    hand.tick(hand.request())
    hand.tick(forged(broken.get("counter", 100)))


@requirement("P6")
@pytest.mark.parametrize("counter", [1, 2, 100], ids=["repeated", "next", "jump"])
def test_another_request_disturbs_a_handshake_even_one_that_is_dropped(counter: int) -> None:
    hand = Hand()
    disturbed(hand, counter=counter)
    hand.tick(hand.response(shared=b"z" * 16))
    assert hand.count(Reject.HANDSHAKE) == 1
    assert hand.count(Reject.MAC) == hand.state.mac_failures == 0
    assert hand.state.refusal is Refusal.DISTURBED
    assert hand.state.handshake_rest_ms == hand.now_ms + 500


@requirement("P6")
def test_the_same_request_again_disturbs_nothing() -> None:
    hand = Hand().to_follow()
    request = hand.request()
    hand.tick(request)
    hand.tick(request)  # a bus that doubles
    hand.tick(hand.request())  # a bridge that asks again
    hand.tick(hand.response(shared=b"z" * 16))
    assert (hand.state.mac_failures, hand.state.refusal) == (1, Refusal.KEY)


@requirement("P6")
def test_what_is_no_request_disturbs_nothing() -> None:
    hand = Hand().to_follow()
    hand.tick(hand.request())
    odd = frames.pack(frames.ARM_REQUEST, (1, frames.PURPOSE_ARM))[:7] + b"\x07"  # a purpose that there is not
    hand.tick(Received(frames.ARM_REQUEST, e2e.protect(frames.ARM_REQUEST, odd, 90)))
    hand.tick(Received(frames.ARM_REQUEST, forged(91).data[:7] + b"\xff"))  # a wrong CRC
    hand.tick(hand.response(shared=b"z" * 16))
    assert (hand.state.mac_failures, hand.state.refusal) == (1, Refusal.KEY)


@requirement("P6")
@pytest.mark.parametrize(("wait_ms", "answered"), [(499, False), (500, True)])
def test_after_a_disturbed_handshake_nobody_is_answered_for_half_a_second(wait_ms: int, answered: bool) -> None:
    hand = Hand()
    disturbed(hand)
    hand.tick(hand.response(shared=b"z" * 16))
    hand.run(wait_ms - 1)
    hand.counters[frames.ARM_REQUEST] = 150
    hand.tick(hand.request())
    assert (hand.state.challenge is not None) == answered


@requirement("P6")
@pytest.mark.parametrize(("wait_ms", "blamed"), [(500, 0), (501, 1)])
def test_a_handshake_is_undisturbed_once_the_other_challenge_is_dead(wait_ms: int, blamed: int) -> None:
    hand = Hand()
    disturbed(hand)
    hand.run(wait_ms - 1)
    hand.counters[frames.ARM_REQUEST] = 150
    hand.state.challenge = hand.state.challenge._replace(bridge_nonce=0x11223344)  # type: ignore[union-attr]
    hand.tick(hand.request())
    hand.tick(hand.response(shared=b"z" * 16))
    assert hand.state.mac_failures == blamed


@requirement("P6")
def test_a_refusal_is_forgotten_when_a_session_comes() -> None:
    hand = Hand().to_follow()
    hand.tick(hand.response(session=1))
    assert hand.state.refusal is Refusal.LATE
    hand.arm()
    assert hand.state.refusal is Refusal.NONE
    disturbed_by = hand.request()
    hand.tick(disturbed_by)
    hand.tick(forged(200))
    hand.tick(hand.response(session=99))
    assert hand.state.refusal is Refusal.DISTURBED
    hand = Hand().to_follow()
    hand.tick(hand.request())
    hand.tick(hand.response(session=99))
    assert hand.state.refusal is Refusal.LATE


def test_guesses_in_a_disturbed_handshake_are_two_a_second() -> None:
    rig, guesses = Rig(arm=False), 0
    rig.until("FOLLOW")
    for k in range(2000):
        before = rig.state.handshake_rest_ms
        rig.put(forged(2 * k), forged(2 * k + 1))
        rig.put(forged_response(k, rig.state.last_session or 1, k))
        rig.tick()
        guesses += rig.state.handshake_rest_ms != before
    assert guesses <= 5
    assert not rig.state.armed
