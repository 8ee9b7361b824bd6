"""Requests to the owner of a simulated bus: status, faults, recovery; what cannot be read is answered, never raised."""

from __future__ import annotations

import json
import uuid
from typing import Any

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hilbridge.bus.model.error_frames import ErrorState
from hilbridge.bus.model.faults import Babble, Corruption, QueueStall, Where, WireCut, WireFaults
from hilbridge.bus.model.frames import WireFrame
from hilbridge.bus.model.medium import Medium
from hilbridge.bus.simulated.client import BusClient
from hilbridge.bus.simulated.control import answer
from hilbridge.bus.simulated.requests import FaultsRequest, read_request

WAIT_S = 20.0


def faults(given: dict[str, Any], now_ns: int = 0) -> WireFaults:
    request = read_request(json.dumps({"op": "faults", "faults": given}).encode())
    assert isinstance(request, FaultsRequest), request
    return request.faults.at(now_ns)


def test_faults_are_read_with_times_from_now() -> None:
    read = faults(
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
    assert read.seed == 7
    assert read.corruptions == (Corruption(96, Where.CRC, count=3, until_ns=1_005_000_000), Corruption(None, 12))
    assert read.babbles == (Babble("bridge", 1, b"\x00\x11"),)
    assert read.cuts == (WireCut(frozenset({"bridge"}), 1_001_000_000, 1_002_000_000),)
    assert read.stalls == (QueueStall("device"),)
    assert read.no_ack == {"device"}


@pytest.mark.parametrize(
    ("request_", "says"),
    [
        (b"{", "Invalid JSON"),
        (b"[]", "object"),
        (b"{}", "'op'"),
        (b'{"op": "fly"}', "'fly'"),
        (b'{"op": "status", "more": 1}', "more"),
        (b'{"op": "faults"}', "faults"),
        (b'{"op": "faults", "faults": {"gremlins": 1}}', "gremlins"),
        (b'{"op": "faults", "faults": {"bit_error_rate": 2}}', "bit_error_rate"),
        (b'{"op": "faults", "faults": {"bit_error_rate": 1e999}}', "finite"),
        (b'{"op": "faults", "faults": {"bit_error_rate": NaN}}', "finite"),
        (b'{"op": "faults", "faults": {"bit_error_rate": "0.5"}}', "bit_error_rate"),
        (b'{"op": "faults", "faults": {"seed": true}}', "seed"),
        (b'{"op": "faults", "faults": {"seed": %s}}' % (b"9" * 400), "seed"),
        (b'{"op": "faults", "faults": {"stalls": [{"from": 1}]}}', "stalls.0.node"),
        (b'{"op": "faults", "faults": {"stalls": [{"node": "a", "until_ms": 1e300}]}}', "until_ms"),
        (b'{"op": "faults", "faults": {"stalls": [%s]}}' % b",".join([b'{"node": "a"}'] * 17), "stalls"),
        (b'{"op": "faults", "faults": {"corruptions": [{"can_id": 1, "bit": "moon"}]}}', "bit"),
        (b'{"op": "faults", "faults": {"corruptions": [{"can_id": -1}]}}', "can_id"),
        (b'{"op": "faults", "faults": {"babbles": [{"node": "a", "can_id": 2048}]}}', "can_id"),  # ended the bus once
        (b'{"op": "faults", "faults": {"babbles": [{"node": "a", "data": "0"}]}}', "data"),
        (b'{"op": "faults", "faults": {"babbles": [{"node": "a", "data": "000000000000000000"}]}}', "data"),
        (b'{"op": "faults", "faults": {"cuts": [{"nodes": "abc"}]}}', "nodes"),
        (b'{"op": "faults", "faults": {%s}}' % b",".join(b'"%d":0' % n for n in range(1000)), "1000 mistakes"),
        (b"[" * 10_000, "recursion"),
        (b"\xff\xfe", "Invalid JSON"),
        (b" " * 20_000, "16384 bytes"),
    ],
)
def test_requests_that_cannot_be_read_are_answered(request_: bytes, says: str) -> None:
    medium = Medium()
    before = medium.faults
    error = answer(medium, medium.attach("n"), request_, 0)["error"]
    assert says in error
    assert len(error) <= 210
    assert medium.faults is before


_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)
_entries = st.lists(
    st.dictionaries(
        st.sampled_from(["node", "nodes", "can_id", "bit", "count", "data", "from_ms", "until_ms", "receiver"]),
        _values | st.sampled_from(["n", ["n"], "data", "00", 1, 0x60]),
    ),
    max_size=3,
)
_nearly = st.fixed_dictionaries(
    {"op": st.sampled_from(["status", "faults", "recover"])},
    optional={
        "faults": st.dictionaries(
            st.sampled_from(["seed", "bit_error_rate", "corruptions", "babbles", "cuts", "stalls", "no_ack"]),
            _entries | _values | st.sampled_from([0, 0.5, 1]),
        )
    },
)


@given(st.binary(max_size=60) | _nearly.map(lambda given: json.dumps(given).encode()))
def test_no_request_raises_nor_leaves_a_bus_that_does(raw: bytes) -> None:
    medium = Medium()
    numbers = [medium.attach("n"), medium.attach("m")]
    json.dumps(answer(medium, numbers[0], raw, 0))
    for number in numbers:
        medium.send(number, WireFrame(0x60, b"12345678"), 1, 0)
    for _ in range(50):
        medium.advance_to_event(10_000_000)


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
