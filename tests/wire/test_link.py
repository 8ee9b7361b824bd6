from __future__ import annotations

import pytest

from hilbridge.records import Frame
from hilbridge.wire.codec import Decoded, Rejected, RejectReason
from hilbridge.wire.e2e import MachineState
from hilbridge.wire.link import WireLink
from tests.wire.shared import CODEC, status

requirement = pytest.mark.requirement


@requirement("P8", "P9")
def test_the_link_counts_every_drop_under_its_reason() -> None:
    device, bridge = WireLink(CODEC, "CONTROLLER"), WireLink(CODEC)
    first = status(device, State="Follow")
    assert isinstance(bridge.decode(first), Decoded)
    again = bridge.decode(first)
    assert isinstance(again, Rejected)
    assert again.reason is RejectReason.REPEATED
    bad = Frame(first.can_id, first.data[:7] + bytes((first.data[7] ^ 1,)))
    assert bridge.decode(bad).reason is RejectReason.CRC  # type: ignore[union-attr]
    for _ in range(3):
        status(device)
    assert isinstance(bridge.decode(status(device)), Decoded)
    assert bridge.counters["LostFrames"] == 3
    for _ in range(6):
        status(device)
    assert bridge.decode(status(device)).reason is RejectReason.SEQUENCE  # type: ignore[union-attr]
    assert bridge.decode(Frame(0xA0, b"")).reason is RejectReason.LENGTH  # type: ignore[union-attr]
    assert bridge.counters["RxAccepted"] == 2
    assert sum(bridge.counters.values()) == 7 - 1 + 3


@requirement("P1")
def test_an_invalid_machine_drops_frames_until_trust_is_earned() -> None:
    device, bridge = WireLink(CODEC, "CONTROLLER"), WireLink(CODEC)
    for _ in range(2):
        bridge.decode(status(device))
    assert bridge.machine("CTRL_STATUS") is MachineState.VALID
    assert bridge.machine("CTRL_MEAS") is MachineState.NO_DATA
    for _ in range(2):
        bridge.decode(Frame(0xA0, bytes(8)))
    assert bridge.machine("CTRL_STATUS") is MachineState.INVALID
    outcomes = [bridge.decode(status(device)) for _ in range(4)]
    assert [isinstance(outcome, Decoded) for outcome in outcomes] == [False, False, False, True]
    assert bridge.counters["RejE2EState"] == 3


def test_own_messages_from_outside_are_no_message_of_a_device() -> None:
    other, bridge = WireLink(CODEC), WireLink(CODEC)
    outcome = bridge.decode(other.encode("ACT_CMD", {}))
    assert isinstance(outcome, Rejected)
    assert outcome.reason is RejectReason.UNKNOWN_ID


@requirement("P3")
def test_stop_carries_nothing_and_is_always_taken() -> None:
    link = WireLink(CODEC)
    stop = link.encode("STOP", {})
    assert (stop.can_id, stop.data) == (1, b"")
    for _ in range(3):
        outcome = link.decode(stop)
        assert isinstance(outcome, Decoded)
        assert outcome.name == "STOP"


@pytest.mark.parametrize("kind", ["is_error", "is_fd", "is_extended", "is_remote"])
def test_h9_a_frame_of_another_kind_moves_no_counter_and_is_counted_as_such(kind: str) -> None:
    device, bridge = WireLink(CODEC, "CONTROLLER"), WireLink(CODEC)
    frame = status(device)
    outcome = bridge.decode(frame._replace(**{kind: True}))
    assert isinstance(outcome, Rejected)
    assert (outcome.reason, outcome.name) == (RejectReason.KIND, "")
    assert bridge.machine("CTRL_STATUS") is MachineState.NO_DATA
    assert isinstance(bridge.decode(frame), Decoded)


def test_the_first_frame_of_a_message_has_counter_one() -> None:
    assert WireLink(CODEC).encode("ACT_CMD", {}).data[2] == 1
