"""A forged or flooded ARM_REQUEST delays arming while it lasts and no longer; a wrong key is still told apart (H1)."""

from __future__ import annotations

import pytest

from firmware_sim import e2e, frames
from firmware_sim.memory import COUNT_MAC_FAILURES, Received
from tests.safety.rig import Rig


def forged(counter: int) -> Received:
    data = frames.pack(frames.ARM_REQUEST, (0xF0000000 + counter, frames.PURPOSE_ARM))
    return Received(frames.ARM_REQUEST, e2e.protect(frames.ARM_REQUEST, data, counter & 0xFF))


@pytest.mark.parametrize("offset_ms", range(-3, 4))
def test_one_forged_request_is_not_taken_for_a_wrong_key(offset_ms: int) -> None:
    first = Rig()
    while not any(frame.can_id == frames.ARM_REQUEST for frame in first.sent):
        first.tick()
    rig, asked_ms = Rig(), first.now_ms
    for _ in range(4000):
        if rig.now_ms == asked_ms + offset_ms:
            rig.put(forged(200))
        rig.tick()
    assert rig.bridge.session.armed
    assert not rig.bridge.session.refused
    assert rig.state.counters[COUNT_MAC_FAILURES] == 0


@pytest.mark.parametrize("every_ms", [1, 3, 10, 40, 170])
def test_a_flood_delays_arming_for_two_seconds_at_most_after_it_ends(every_ms: int) -> None:
    rig = Rig()
    for k in range(5000):
        if k % every_ms == 0:
            rig.put(forged(k // every_ms + 1))
        rig.tick()
    assert rig.state.state.name != "LATCHED"
    assert not rig.bridge.session.refused
    for _ in range(2000):
        rig.tick()
    assert rig.bridge.session.armed


def test_guesses_in_a_disturbed_handshake_are_two_a_second() -> None:
    rig, guesses = Rig(arm=False), 0
    rig.until("FOLLOW")
    for k in range(2000):
        before = rig.state.handshake_rest_ms
        rig.put(forged(2 * k), forged(2 * k + 1))
        data = frames.pack(frames.ARM_RESPONSE, (k, rig.state.last_session or 1))
        rig.put(Received(frames.ARM_RESPONSE, e2e.protect(frames.ARM_RESPONSE, data, k & 0xFF)))
        rig.tick()
        guesses += rig.state.handshake_rest_ms != before
    assert guesses <= 5
    assert not rig.state.armed
