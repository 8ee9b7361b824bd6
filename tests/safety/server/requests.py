"""Fuzzed requests to a simulated bus: right ones, nearly right ones, and rubbish, as records on the link."""

from __future__ import annotations

import json
import random
from typing import Any

from hilbridge.bus.simulated.protocol import Flag, Kind, Record, in_parts
from hilbridge.bus.simulated.requests import FaultsRequest, read_request

_LEAST_ID = 0x100  # honest clients' frames are more urgent: what delays them then is not arbitration
_ODD: tuple[Any, ...] = (
    None,
    True,
    -1,
    0,
    1,
    2**31,
    2**63,
    2**70,
    0.5,
    -0.5,
    1e300,
    "",
    "x" * 300,
    [],
    {},
    [[]],
    "\ud800",
)
_RAW = (
    b"",
    b"{",
    b"[" * 12_000,
    b'{"op":' * 200,
    b'{"op": "status", "x": 1e999}',
    b'{"op": "faults", "faults": {"bit_error_rate": 1e999}}',
    b'{"op": "faults", "faults": {"bit_error_rate": NaN}}',
    b'{"op": "faults", "faults": {"babbles": [{"node": "fuzz", "can_id": 4096}]}}',
    b'{"op": "faults", "faults": {"babbles": [{"node": "fuzz", "can_id": -1}]}}',
    b'{"op": "faults", "faults": {%s}}' % b",".join(b'"%d":0' % number for number in range(1500)),
    b"9" * 5000,
    b"\xff" * 70,
    b" " * 40_000,
)


def _node(rng: random.Random) -> str:
    return f"fuzz {rng.randrange(8)}"


def _times(rng: random.Random) -> dict[str, float]:
    times = {}
    if rng.random() < 0.5:
        times["from_ms"] = rng.uniform(-10, 20)
    if rng.random() < 0.8:
        times["until_ms"] = rng.uniform(0, 50)
    return times


def faults(rng: random.Random, *, wild: bool) -> dict[str, Any]:
    """Faults that the bus takes; unless `wild`, such as harm the fuzzer's own nodes and frames only."""
    given: dict[str, Any] = {"seed": rng.getrandbits(32)}
    kind = rng.randrange(6)
    if kind == 0:
        bit = rng.choice(["data", "crc", "ack", "eof", rng.randrange(-200, 200)])
        can_id = None if wild else rng.randrange(_LEAST_ID, 0x7FF)
        given["corruptions"] = [{"can_id": can_id, "bit": bit, "count": rng.choice([1, 40, 10**9]), **_times(rng)}]
    elif kind == 1:
        can_id = rng.randrange(0 if wild else _LEAST_ID, 0x800)
        given["babbles"] = [{"node": _node(rng), "can_id": can_id, "data": rng.randbytes(rng.randrange(9)).hex()}]
        given["babbles"][0] |= _times(rng)
    elif kind == 2:
        given["cuts"] = [{"nodes": [_node(rng) for _ in range(rng.randrange(1, 6))], **_times(rng)}]
    elif kind == 3:
        given["stalls"] = [{"node": _node(rng), **_times(rng)}]
    elif kind == 4:
        given["no_ack"] = [_node(rng) for _ in range(rng.randrange(4))]
    elif wild:
        given |= {"bit_error_rate": rng.choice([1.0, 0.3, 0.01]), "local_share": rng.random()}
        given["babbles"] = [{"node": f"fuzz {number}", "can_id": 0x100 + number} for number in range(8)]
    return given


def _spoilt(rng: random.Random, given: dict[str, Any]) -> dict[str, Any]:
    """One entry, somewhere, exchanged for something odd, or one too many."""
    place: Any = given
    while True:
        keys = list(place) if isinstance(place, dict) else list(range(len(place)))
        if not keys:
            return given
        key = rng.choice(keys)
        if isinstance(place[key], (dict, list)) and rng.random() < 0.8:
            place = place[key]
            continue
        if isinstance(place, dict) and rng.random() < 0.2:
            place[rng.choice(["more", "bit", "nodes", "", "\n"])] = rng.choice(_ODD)
        else:
            place[key] = rng.choice(_ODD)
        return given


def harms_others(raw: bytes) -> bool:
    """Whether the bus takes this request, and it harms more than the fuzzers' own frames.

    Something odd in the right place does: a corruption of every identifier, a babble more urgent than any frame.
    """
    request = read_request(raw)
    if not isinstance(request, FaultsRequest):
        return False
    asked = request.faults
    identifiers = [entry.can_id for entry in (*asked.corruptions, *asked.babbles)]
    return asked.bit_error_rate > 0 or any(can_id is None or can_id < _LEAST_ID for can_id in identifiers)


def _control(rng: random.Random, *, wild: bool) -> bytes:
    while True:
        raw = _one_control(rng, wild=wild)
        if wild or not harms_others(raw):
            return raw


def _one_control(rng: random.Random, *, wild: bool) -> bytes:
    choice = rng.random()
    if choice < 0.15:
        return rng.choice(_RAW[:2] + _RAW[3:]) if rng.random() < 0.2 else rng.randbytes(rng.randrange(64))
    if choice < 0.16:
        return rng.choice(_RAW)
    given: dict[str, Any] = {"op": rng.choice(["status", "recover", "faults", "faults", "faults", "faults"])}
    if given["op"] == "faults":
        given["faults"] = faults(rng, wild=wild)
    if choice < 0.7:
        given = _spoilt(rng, given)
    raw = bytearray(json.dumps(given).encode())
    if choice > 0.9 and raw:
        raw[rng.randrange(len(raw))] = rng.randrange(256)
    return bytes(raw)


def _frame(rng: random.Random) -> bytes:
    flags = rng.choice([0, 0, 0, Flag.EXTENDED, Flag.FD, Flag.FD | Flag.SWITCH, Flag.REMOTE, rng.randrange(256)])
    can_id = rng.choice(
        [rng.randrange(_LEAST_ID, 0x800), rng.randrange(_LEAST_ID, 0x800), rng.getrandbits(32) | 1 << 26]
    )
    data = rng.randbytes(rng.choice([0, 1, 7, 8, 8, 9, 64]))
    return Record(Kind.FRAME, flags, rng.choice([0, 8, 200]), can_id, 0, rng.getrandbits(32), 0, data).pack()


def _rubbish(rng: random.Random) -> bytes:
    """A whole record that is none, or none for a server; a HELLO in the middle of a session among them."""
    kind = rng.choice([0, Kind.HELLO, Kind.WELCOME, Kind.REFUSED, Kind.SENT, Kind.STATE, Kind.ANSWER, 10, 77, 255])
    return Record(kind, *rng.randbytes(2), rng.getrandbits(32), -rng.getrandbits(60), 5, 6, rng.randbytes(64)).pack()


def fuzzed(rng: random.Random, *, wild: bool = False) -> tuple[bytes, int]:
    """One request as bytes on the link, and how many answers must come."""
    choice = rng.random()
    if choice < 0.45:
        return _frame(rng), 0
    if choice < 0.55:
        return _rubbish(rng), 0
    return in_parts(Kind.CONTROL, _control(rng, wild=wild)), 1
