"""Requests to the owner of a simulated bus: status, faults, recovery; what cannot be read is answered, never raised."""

from __future__ import annotations

import json
import uuid

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.bus.model.error_frames import ErrorState
from hilbridge.bus.model.faults import Babble, Corruption, QueueStall, Where, WireCut
from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.model.medium import Medium
from hilbridge.bus.simulated.client import BusClient
from hilbridge.bus.simulated.control import answer, faults_from_json

WAIT_S = 20.0


def test_faults_are_read_with_times_from_now() -> None:
    faults = faults_from_json(
        {
            "seed": 7,
            "bit_error_rate": 0.001,
            "local_share": 0.5,
            "corruptions": [{"can_id": 96, "bit": "crc", "count": 3, "until_ms": 5}, {"can_id": None, "bit": 12}],
            "babbles": [{"node": "bridge", "can_id": 1, "data": "0011"}],
            "cuts": [{"nodes": ["bridge"], "from_ms": 1, "until_ms": 2}],
            "stalls": [{"node": "device"}],
            "no_ack": ["device"],
        },
        1_000_000_000,
    )
    assert faults.seed == 7
    assert faults.corruptions == (
        Corruption(96, Where.CRC, count=3, until_ns=1_005_000_000),
        Corruption(None, 12),
    )
    assert faults.babbles == (Babble("bridge", 1, b"\x00\x11"),)
    assert faults.cuts == (WireCut(frozenset({"bridge"}), 1_001_000_000, 1_002_000_000),)
    assert faults.stalls == (QueueStall("device"),)
    assert faults.no_ack == {"device"}


@pytest.mark.parametrize(
    ("request_", "says"),
    [
        (b"{", "JSONDecodeError"),
        (b"[]", "TypeError"),
        (b"{}", "KeyError"),
        (b'{"op": "fly"}', "unknown request 'fly'"),
        (b'{"op": "faults", "faults": {"gremlins": 1}}', "unknown fault 'gremlins'"),
        (b'{"op": "faults", "faults": {"bit_error_rate": 2}}', "bit_error_rate"),
        (b'{"op": "faults", "faults": {"stalls": [{"from": 1}]}}', "TypeError"),
        (b'{"op": "faults", "faults": {"corruptions": [{"can_id": 1, "bit": "moon"}]}}', "moon"),
    ],
)
def test_requests_that_cannot_be_read_are_answered(request_: bytes, says: str) -> None:
    medium = Medium()
    assert says in answer(medium, medium.attach("n"), request_, 0)["error"]


@given(st.binary(max_size=60))
def test_no_request_raises(raw: bytes) -> None:
    medium = Medium()
    json.dumps(answer(medium, medium.attach("n"), raw, 0))


def test_a_fault_put_into_a_running_bus_shows_at_both_ends() -> None:
    name = f"test-{uuid.uuid4()}"
    sender, receiver = BusClient(name, node="sender"), BusClient(name, node="receiver")
    try:
        # Thirty-two destroyed attempts take the sender off the bus; it recovers and the next frame passes.
        fault = {"corruptions": [{"can_id": 0x100, "bit": "data", "count": 32}]}
        assert sender.control({"op": "faults", "faults": fault}) == {"ok": True}
        sender.send(WireFrame(0x100, b"\x12\x34"))
        seen = []
        while len(seen) < 4:
            assert sender.wait_readable(WAIT_S)
            arrival = sender.receive()
            if arrival is not None:
                assert arrival.error
                seen.append(arrival)
        status = receiver.control({"op": "status"})
        by_name = {node["name"]: node for node in status["nodes"]}
        assert set(by_name) == {"sender", "receiver"}
        assert (by_name["sender"]["failures"], by_name["sender"]["lost_frames"]) == (32, 1)
        assert status["fault_effects"] == {"corruption": 32}
        assert status["busy_ns"] > 0
        sender.refresh()
        assert (sender.state, sender.refused, sender.in_flight) == (ErrorState.ACTIVE, 1, 0)
        sender.send(WireFrame(0x101))
        assert receiver.wait_readable(WAIT_S)
        arrival = receiver.receive()
        assert arrival is not None
        assert arrival.frame == WireFrame(0x101)
    finally:
        sender.close()
        receiver.close()


def test_bus_off_refuses_frames_across_processes() -> None:
    name = f"test-{uuid.uuid4()}"
    with can.Bus(interface="hilsim", channel=name, node="one") as one, can.Bus(interface="hilsim", channel=name):
        fault = {"corruptions": [{"can_id": 0x100, "count": 1000}]}
        assert one.node.control({"op": "faults", "faults": fault}) == {"ok": True}  # type: ignore[attr-defined]
        one.send(can.Message(arbitration_id=0x100, data=b"\x12\x34", is_extended_id=False))
        told = [one.recv(WAIT_S) for _ in range(3)]
        assert all(message is not None and message.is_error_frame for message in told)


def test_numbers_that_are_none_and_deep_nesting_are_refused() -> None:
    for request in (b'{"op": "status", "x": 1e999}', b'{"op": "status", "x": NaN}', b"[" * 60_000):
        assert "error" in answer(Medium(500_000, 2_000_000), 1, request, 0)
